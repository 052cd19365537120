//! The zoo of meshes beside the repository, where there is one: every file is the mesh that it should be, or fails for
//! the reason that it should.
//!
//! Vertices, edges, faces, components, boundary loops and non-manifold edges of OBJ, OFF, PLY, STL and VTK files were
//! counted independently (OBJ and OFF from their lines in Python, the others as VTK 9.7 reads them); those of glTF files in
//! `tests/ingest.rs`' way, from the JSON. gc_fan3 and gc_triple_vierbein branch, so that what a loop is depends on the fans
//! there: their loops are this program's.

use std::collections::BTreeSet;
use std::path::PathBuf;

use chladni::mesh::{Fault, Topology, load};

/// [vertices, edges, faces, components, boundary loops, non-manifold edges].
type Counts = [usize; 6];

const MESHES: [(&str, Counts); 25] = [
    ("blub_low.obj", [945, 2829, 1886, 1, 0, 0]),
    ("bunny1.obj", [102, 300, 200, 1, 0, 0]),
    ("bunny2.obj", [502, 1500, 1000, 1, 0, 0]),
    ("gc_fan3.obj", [5, 7, 3, 1, 1, 1]),
    ("gc_hourglass_ico.obj", [23, 60, 40, 1, 0, 0]),
    ("gc_lego.ply", [1649, 4720, 3072, 1, 1, 0]),
    ("gc_moebius.obj", [280, 728, 448, 1, 1, 0]),
    ("gc_spot.ply", [2930, 8784, 5856, 1, 0, 0]),
    ("gc_triple_vierbein.obj", [75, 182, 108, 1, 1, 20]),
    ("horse.obj", [152, 450, 300, 1, 0, 0]),
    ("lapy_cubeTria.vtk", [2402, 7200, 4800, 1, 0, 0]),
    ("lapy_icosahedron.off", [12, 30, 20, 1, 0, 0]),
    ("lapy_square-mesh.off", [415, 1182, 768, 1, 1, 0]),
    ("lapy_torus.off", [576, 1728, 1152, 1, 0, 0]),
    ("spot_11533.obj", [11533, 34593, 23062, 1, 0, 0]),
    ("spot_829.obj", [829, 2481, 1654, 1, 0, 0]),
    ("torus.obj", [100, 300, 200, 1, 0, 0]),
    ("trimesh_BoxInterleaved.glb", [8, 18, 12, 1, 0, 0]),
    ("trimesh_Duck.glb", [2108, 6318, 4212, 1, 0, 0]),
    ("trimesh_mode5.gltf", [1476, 4285, 2786, 4, 13, 0]),
    ("trimesh_negative_indices.obj", [8, 18, 12, 1, 0, 0]),
    ("trimesh_nested.glb", [24, 54, 36, 3, 0, 0]),
    ("trimesh_no_indices_3storybuilding.glb", [24, 78, 64, 1, 0, 22]),
    ("trimesh_notenoughindices.obj", [3, 3, 1, 1, 1, 0]),
    ("trimesh_soup.stl", [300, 300, 100, 100, 100, 0]),
];

type IsExpected = fn(&Fault) -> bool;

const FAILURES: [(&str, IsExpected); 3] = [
    // Eigenvalues that LaPy wrote; no mesh.
    ("lapy_cubeTria.ev", |fault| matches!(fault, Fault::UnknownFormat { .. })),
    // Its .bin file is not there.
    ("trimesh_Mesh_PrimitiveMode_04.gltf", |fault| matches!(fault, Fault::Buffer { .. })),
    // It has one vertex, and a group whose name holds an `f`.
    ("trimesh_face_in_group_name.obj", |fault| matches!(fault, Fault::NoSurface { .. })),
];

/// The folder, where there is one.
fn zoo() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data"));
    if !folder.is_dir() {
        println!("skipped: {} is not there", folder.display());
    }
    folder.is_dir().then_some(folder)
}

fn counts(topology: &Topology) -> Counts {
    let Topology { vertices, edges, faces, components, boundary_loops, .. } = *topology;
    [vertices, edges, faces, components, boundary_loops, topology.non_manifold_edges]
}

#[test]
fn every_mesh_is_what_it_should_be() {
    let Some(zoo) = zoo() else { return };
    let found = MESHES.map(|(name, _)| {
        let mesh = load(&zoo.join(name)).unwrap_or_else(|error| panic!("{error}"));
        (name, counts(&mesh.topology))
    });
    assert_eq!(found, MESHES);
}

#[test]
fn every_failure_has_its_reason() {
    let Some(zoo) = zoo() else { return };
    for (name, is_expected) in FAILURES {
        let error = load(&zoo.join(name)).unwrap_err();
        assert!(is_expected(&error.fault), "{error}");
    }
}

#[test]
fn the_tables_name_every_file() {
    let Some(zoo) = zoo() else { return };
    let files = std::fs::read_dir(zoo).unwrap().map(|entry| entry.unwrap().file_name());
    let names = files.map(|name| name.into_string().unwrap());
    let found: BTreeSet<String> =
        names.filter(|name| name != "README.md" && !name.starts_with('.')).collect();
    let listed = MESHES.iter().map(|(name, _)| name).chain(FAILURES.iter().map(|(name, _)| name));
    assert_eq!(found, listed.map(|name| name.to_string()).collect());
}
