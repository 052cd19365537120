//! Every mesh that we have, good and broken: it is solved with a certificate that holds, or refused with a reason.

use std::path::Path;

use chladni::mesh::load;
use chladni::mesh::topology::component_labels;
use chladni::operators::{Boundary, OperatorOptions, Operators, Robust};

use super::{Surface, meshes, shared};

/// Solves for the lowest eigenvalues of a mesh and judges them; why the mesh has none.
fn judge(path: &Path, robust: Robust) -> Result<(), String> {
    let mesh = load(path).map_err(|error| error.to_string())?.mesh;
    let options = OperatorOptions { robust, ..Default::default() };
    let operators = Operators::assemble(&mesh, options).map_err(|error| error.to_string())?;
    let surface =
        Surface { operators, labels: component_labels(&mesh), boundary: Boundary::Neumann };
    let k = mesh.n().min(10);
    let certificate = surface.certificate(&surface.lowest(k).vectors);
    let name = path.display();
    assert!(certificate.completeness.complete, "{name}: {certificate:?}");
    assert!(certificate.orthonormality < 1e-8, "{name}: {certificate:?}");
    let area = surface.operators.area.0;
    let positive = certificate.pairs.iter().map(|pair| pair.lambda).find(|l| l * area > 1e-6);
    let first = positive.unwrap_or(1.0 / area);
    for pair in &certificate.pairs {
        assert!(pair.residual <= 1e-6 * pair.lambda.max(first), "{name}: {pair:?}");
    }
    Ok(())
}

/// The names of the meshes in a folder that are refused.
fn refused(folder: &Path, robust: Robust) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let format =
        |path: &Path| path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_owned();
    let mut refused: Vec<String> = entries
        .filter(|path| {
            ["obj", "off", "ply", "stl", "vtk", "vtp", "gltf", "glb"]
                .contains(&format(path).as_str())
        })
        .filter_map(|path| {
            let reason = judge(&path, robust).err()?;
            assert!(reason.len() > path.to_str().unwrap().len(), "{}: {reason}", path.display());
            Some(path.file_name().unwrap().to_str().unwrap().to_owned())
        })
        .collect();
    refused.sort();
    refused
}

#[test]
fn every_mesh_of_ours_is_certified_or_refused() {
    for robust in Robust::ALL {
        // The first has no face; the second is compressed in a way that is not read.
        let expected = ["trimesh_face_in_group_name.obj", "vtk_lz4.vtp"];
        assert_eq!(refused(&meshes(), robust), expected, "{robust:?}");
    }
}

#[test]
fn every_shared_mesh_is_certified_or_refused() {
    if !shared().exists() {
        eprintln!("left out: there is no {}", shared().display());
        return;
    }
    for robust in Robust::ALL {
        // The buffer of the first is in a file that is not there; the second has no face.
        let expected = ["trimesh_Mesh_PrimitiveMode_04.gltf", "trimesh_face_in_group_name.obj"];
        assert_eq!(refused(&shared(), robust), expected, "{robust:?}");
    }
}
