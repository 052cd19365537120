//! What is written of a mesh in every format, by the real binary, and read back.

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use chladni::mesh::{TriMesh, load, sample::icosphere};
use chladni::operators::Sparse;
use common::{FEM, Workspace, ellipsoid, text};
use npyz::npz::NpzArchive;
use serde_json::Value;

const K: usize = 9;

const ALL: [&str; 4] = [
    "--set",
    "publish.formats=[\"json\", \"ply\", \"vtk\", \"vtu\", \"glb\", \"csv\", \"mat\", \"operators\", \"mtx\"]",
    "--set",
    "publish.descriptors=[\"hks\", \"wks\", \"gps\", \"shape-dna\", \"spectral-coordinates\"]",
];

const FILES: [&str; 17] = [
    "descriptors.npz",
    "eigen.glb",
    "eigen.json",
    "eigen.mat",
    "eigen.npz",
    "eigen.ply",
    "eigen.vtk",
    "eigen.vtu",
    "graph_laplacian.mtx",
    "graph_laplacian.npz",
    "mass.mtx",
    "mass.npz",
    "run.json",
    "spectrum.csv",
    "spectrum.json",
    "stiffness.mtx",
    "stiffness.npz",
];

/// The files in the folder of a mesh.
struct Results(BTreeMap<String, Vec<u8>>);

impl Results {
    fn of(workspace: &Workspace, mesh: &str) -> Self {
        let entries = fs::read_dir(workspace.path("out").join(mesh)).unwrap();
        let paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        Self(paths.iter().map(|path| (name(path), fs::read(path).unwrap())).collect())
    }

    fn names(&self) -> Vec<&str> {
        self.0.keys().map(String::as_str).collect()
    }

    fn text(&self, file: &str) -> &str {
        std::str::from_utf8(&self.0[file]).unwrap()
    }

    fn shape(&self, file: &str, array: &str) -> Vec<u64> {
        let mut npz = NpzArchive::new(Cursor::new(&self.0[file])).unwrap();
        npz.by_name(array).unwrap().unwrap().shape().to_vec()
    }

    fn array<T: npyz::Deserialize>(&self, file: &str, array: &str) -> Vec<T> {
        let mut npz = NpzArchive::new(Cursor::new(&self.0[file])).unwrap();
        npz.by_name(array).unwrap().unwrap().into_vec().unwrap()
    }

    /// What `scipy.sparse.load_npz` would make of it.
    fn sparse(&self, file: &str) -> Sparse {
        let [indices, indptr] = ["indices", "indptr"].map(|name| {
            self.array::<i32>(file, name).into_iter().map(|i| i as usize).collect::<Vec<_>>()
        });
        let [rows, columns] = self.array::<i64>(file, "shape")[..] else { panic!("{file}") };
        assert_eq!(self.array::<String>(file, "format"), ["csr"]);
        let shape = (rows as usize, columns as usize);
        Sparse::new(shape, indptr, indices, self.array(file, "data"))
    }

    /// The entries of a Matrix Market file; both triangles of a symmetric one.
    fn market(&self, file: &str) -> BTreeMap<(usize, usize), f64> {
        let mut lines = self.text(file).lines();
        let symmetric = lines.next().unwrap().ends_with("symmetric");
        let entries = lines.skip(1).flat_map(|line| {
            let mut words = line.split(' ');
            let mut index = || words.next().unwrap().parse::<usize>().unwrap() - 1;
            let (i, j) = (index(), index());
            let value: f64 = words.next().unwrap().parse().unwrap();
            let mirrored = (symmetric && i != j).then_some(((j, i), value));
            [((i, j), value)].into_iter().chain(mirrored)
        });
        entries.collect()
    }
}

fn workspace() -> Workspace {
    Workspace::new(&FEM.replace("k = 4", &format!("k = {K}")))
}

#[test]
fn every_format_reads_back_to_the_same_eigenpairs() {
    let workspace = workspace();
    assert_eq!(workspace.report(&ALL).0, 0);
    let results = Results::of(&workspace, "sphere.obj");
    assert_eq!(results.names(), FILES);
    let mesh = icosphere(2);
    let n = mesh.n();
    let evals: Vec<f64> = results.array("eigen.npz", "evals");
    let evecs: Vec<f64> = results.array("eigen.npz", "evecs");
    let phi = |k: usize| -> Vec<f64> { (0..n).map(|i| evecs[i * K + k]).collect() };

    let json: Value = serde_json::from_slice(&results.0["eigen.json"]).unwrap();
    let numbers = |value: &Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    assert_eq!(numbers(&json["eigenvalues"]), evals);
    assert_eq!(numbers(&json["eigenvectors"][4]), phi(4));

    for file in ["eigen.ply", "eigen.vtk"] {
        let read = load(&workspace.path("out/sphere.obj").join(file)).unwrap().mesh;
        assert_eq!(read, mesh, "{file}");
    }
    let bytes = |values: &[f64], encode: fn(f64) -> [u8; 8]| -> Vec<u8> {
        values.iter().flat_map(|&value| encode(value)).collect()
    };
    let last = bytes(&phi(K - 1), f64::to_be_bytes);
    assert_eq!(
        results.0["eigen.vtk"].strip_suffix(b"\n").unwrap().strip_suffix(&last[..]).map(|_| ()),
        Some(())
    );
    let array = results.text("eigen.vtu").split("Name=\"phi_3\"").nth(1).unwrap();
    let array = STANDARD.decode(array.lines().nth(1).unwrap()).unwrap();
    assert_eq!(array[8..], bytes(&phi(2), f64::to_le_bytes));

    let gltf = gltf::Gltf::from_slice(&results.0["eigen.glb"]).unwrap();
    let names: Vec<&str> = gltf.nodes().map(|node| node.name().unwrap()).collect();
    assert_eq!(names.len(), K);
    assert_eq!((names[0], names[8]), ("phi_1", "phi_9"));
    let primitive = gltf.meshes().nth(1).unwrap().primitives().next().unwrap();
    let reader = primitive.reader(|_| gltf.blob.as_deref());
    assert_eq!(reader.read_positions().unwrap().len(), n);
    let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
    assert_eq!(indices, mesh.faces().as_flattened());
    // Where φ₂ is largest it is yellow, where it is least purple.
    let colours: Vec<[f32; 3]> = reader.read_colors(0).unwrap().into_rgb_f32().collect();
    let at = |pick: fn(&f64, &f64) -> std::cmp::Ordering| {
        let function = phi(1);
        (0..n).max_by(|&a, &b| pick(&function[a], &function[b])).unwrap()
    };
    let (high, low) = (colours[at(f64::total_cmp)], colours[at(|a, b| b.total_cmp(a))]);
    assert!(high[1] > 0.5 && high[2] < 0.1, "{high:?}");
    assert!(low[1] < 0.01 && low[2] > 0.05, "{low:?}");

    let mut lines = results.text("spectrum.csv").lines();
    assert!(lines.next().unwrap().starts_with("k,lambda,lambda_area,"));
    let lambdas: Vec<f64> =
        lines.map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
    assert_eq!(lambdas, evals);

    let mat = &results.0["eigen.mat"];
    assert_eq!((&mat[..19], &mat[126..128]), (&b"MATLAB 5.0 MAT-file"[..], &b"IM"[..]));
    // The header, and of `evals` the tags, flags, dimensions and name before its values.
    assert_eq!(mat[128 + 8 + 16 + 16 + 16 + 8..][..8 * K], bytes(&evals, f64::to_le_bytes));
}

/// The programs that people use, in Python: of `CHLADNI_PYTHON`, which has to have them, or of the one that is found, where what is not
/// installed is passed over.
#[test]
fn other_peoples_libraries_read_the_same_numbers() {
    let given = std::env::var("CHLADNI_PYTHON").ok();
    let python = given.clone().unwrap_or("python3".into());
    let has_numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if !has_numpy.is_ok_and(|output| output.status.success()) {
        assert_eq!(given, None, "it has no numpy");
        eprintln!("skipped: {python} has no numpy");
        return;
    }
    let workspace = workspace();
    let (exit, _) = workspace.report(&ALL);
    assert_eq!(exit, 0);
    let example = |name: &str| {
        let examples = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/examples"));
        let folder = workspace.path("out/sphere.obj");
        let output = Command::new(&python).arg(examples.join(name)).arg(folder).output().unwrap();
        assert!(output.status.success(), "{}", text(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let read = example("read_back.py");
    eprintln!("{read}");
    assert!(read.contains("eigen.json") && read.contains("spectrum.csv"), "{read}");
    if given.is_some() {
        for file in [
            "eigen.vtu            meshio",
            "eigen.mat            SciPy",
            "mass.mtx             SciPy",
        ] {
            assert!(read.contains(file), "{file}: {read}");
        }
    }
    let apart: Vec<f64> = example("hks.py")
        .lines()
        .filter_map(|line| line.strip_suffix(" apart")?.rsplit(' ').next()?.parse().ok())
        .collect();
    assert!(apart.len() == 3 && apart.iter().all(|&apart| apart < 1e-12), "{apart:?}");
}

#[test]
fn the_matrices_are_those_of_the_eigenpairs() {
    let workspace = workspace();
    assert_eq!(workspace.report(&ALL).0, 0);
    let results = Results::of(&workspace, "sphere.obj");
    let [stiffness, mass, laplacian] =
        ["stiffness", "mass", "graph_laplacian"].map(|name| results.sparse(&format!("{name}.npz")));
    let evals: Vec<f64> = results.array("eigen.npz", "evals");
    let evecs: Vec<f64> = results.array("eigen.npz", "evecs");
    let n = stiffness.rows();
    let times = |matrix: &Sparse, x: &[f64]| -> Vec<f64> {
        matrix.outer_iterator().map(|row| row.iter().map(|(j, v)| v * x[j]).sum()).collect()
    };
    for k in 0..K {
        let phi: Vec<f64> = (0..n).map(|i| evecs[i * K + k]).collect();
        let (l, b) = (times(&stiffness, &phi), times(&mass, &phi));
        let residual: f64 =
            l.iter().zip(&b).map(|(l, b)| (l - evals[k] * b).abs()).fold(0.0, f64::max);
        let norm: f64 = phi.iter().zip(&b).map(|(phi, b)| phi * b).sum();
        assert!(residual < 1e-9 && (norm - 1.0).abs() < 1e-10, "{k}: {residual} {norm}");
    }
    assert!(times(&laplacian, &vec![1.0; n]).iter().all(|row| row.abs() < 1e-14));
    for (name, matrix) in [("stiffness", stiffness), ("mass", mass), ("graph_laplacian", laplacian)]
    {
        let entries: BTreeMap<_, _> = matrix.iter().map(|(&v, (i, j))| ((i, j), v)).collect();
        assert_eq!(results.market(&format!("{name}.mtx")), entries, "{name}");
    }
}

#[test]
fn descriptors_are_the_formulas_of_the_arrays_beside_them() {
    let workspace = workspace();
    assert_eq!(workspace.report(&ALL).0, 0);
    let results = Results::of(&workspace, "sphere.obj");
    let evals: Vec<f64> = results.array("eigen.npz", "evals");
    let evecs: Vec<f64> = results.array("eigen.npz", "evecs");
    let file = "descriptors.npz";
    let n = evecs.len() / K;
    let times: Vec<f64> = results.array(file, "hks_times");
    let hks: Vec<f64> = results.array(file, "hks");
    assert_eq!(results.shape(file, "hks"), [n as u64, 100]);
    assert!((times[0] - 4.0 * 10_f64.ln() / evals[K - 1]).abs() < 1e-12);
    for (x, i) in (0..n).flat_map(|x| [0, 50, 99].map(|i| (x, i))) {
        let term = |k: usize| (-evals[k] * times[i]).exp() * evecs[x * K + k].powi(2);
        let expected: f64 = (0..K).map(term).sum();
        assert!((hks[x * 100 + i] - expected).abs() < 1e-12);
    }
    let gps: Vec<f64> = results.array(file, "gps");
    assert_eq!(results.shape(file, "gps"), [n as u64, 8]);
    assert!((gps[8 + 2] - evecs[K + 3] / evals[3].sqrt()).abs() < 1e-15);
    assert_eq!(results.shape(file, "wks"), [n as u64, 100]);
    let coordinates: Vec<f64> = results.array(file, "spectral_coordinates");
    assert_eq!(coordinates[..3], evecs[1..4]);
    let area: f64 = results.array::<f64>("eigen.npz", "mass").iter().sum();
    let dna: Vec<f64> = results.array(file, "shape_dna");
    assert!(dna.iter().zip(&evals).all(|(dna, lambda)| (dna - lambda * area).abs() < 1e-10));
}

#[test]
fn a_run_compares_its_meshes_and_says_which_could_not_be() {
    let workspace = workspace();
    workspace.write("meshes/egg.obj", &ellipsoid(1.5));
    let scaled = icosphere(2).vertices().iter().map(|p| p.map(|c| 3.0 * c)).collect();
    let scaled = TriMesh::new(scaled, icosphere(2).faces().to_vec()).unwrap();
    workspace.write("meshes/large.obj", &common::obj(&scaled));
    workspace.write("meshes/broken.obj", "v 0 0 0\nf 1 2 3\n");
    assert_eq!(workspace.report(&["--set", "publish.descriptors=[\"shape-dna\"]"]).0, 3);
    let read = |name: &str| -> Vec<Vec<String>> {
        let text = fs::read_to_string(workspace.path("out").join(name)).unwrap();
        text.lines().map(|line| line.split(',').map(String::from).collect()).collect()
    };
    let fingerprints = read("shape_dna.csv");
    let status: Vec<[&str; 2]> =
        fingerprints.iter().map(|line| [line[0].as_str(), line[1].as_str()]).collect();
    assert_eq!(
        status[1..],
        [
            ["broken.obj", "failed"],
            ["egg.obj", "verified"],
            ["large.obj", "verified"],
            ["sphere.obj", "verified"],
        ]
    );
    let lambda: f64 = fingerprints[4][6].parse().unwrap();
    assert!((lambda / (8.0 * std::f64::consts::PI) - 1.0).abs() < 0.05, "{lambda}");
    let distances = read("shape_dna_distances.csv");
    assert_eq!(distances[0], ["mesh", "egg.obj", "large.obj", "sphere.obj"]);
    let distance = |i: usize, j: usize| distances[i][j].parse::<f64>().unwrap();
    assert!(distance(2, 3) < 1e-9, "a sphere is a sphere, however large");
    assert!(distance(1, 3) > 10.0 && distance(1, 3) == distance(3, 1));
}

#[test]
fn equal_work_is_equal_bytes_and_what_is_no_longer_asked_for_goes() {
    let workspace = workspace();
    assert_eq!(workspace.report(&ALL).0, 0);
    let whole = Results::of(&workspace, "sphere.obj").0;
    fs::remove_dir_all(workspace.path("out")).unwrap();
    assert_eq!(workspace.report(&[&ALL[..], &["--jobs", "1"]].concat()).0, 0);
    let mut again = Results::of(&workspace, "sphere.obj").0;
    again.insert("run.json".into(), whole["run.json"].clone());
    assert!(again == whole);
    assert!(workspace.path("out/shape_dna.csv").exists());
    assert_eq!(workspace.report(&[]).0, 0);
    let expected = ["eigen.npz", "eigen.ply", "run.json", "spectrum.json"];
    assert_eq!(Results::of(&workspace, "sphere.obj").names(), expected);
    assert!(!workspace.path("out/shape_dna.csv").exists());
}

#[test]
fn too_few_pairs_fail_the_mesh_with_the_remedy_and_an_old_option_names_the_new_one() {
    let workspace = Workspace::new(&FEM.replace("k = 4", "k = 3"));
    let (code, report) =
        workspace.report(&["--set", "publish.descriptors=[\"spectral-coordinates\"]"]);
    assert_eq!(code, 3);
    let reason = report.meshes[0].reason.as_ref().unwrap();
    assert!(reason.contains("train.k") && reason.contains("publish.descriptors"), "{reason}");
    let output = workspace.run(&["--set", "publish.ply=false"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(common::text(&output).contains("did you mean `publish.formats`?"));
}
