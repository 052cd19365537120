//! The contract of the command line: exit codes, the JSON documents, messages that say what to do.

mod common;

use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::report::Status;
use common::{FEM, QUICK, Workspace, chladni, ellipsoid, obj, text};

#[test]
fn exit_0_and_a_table_when_all_is_well() {
    let workspace = Workspace::new(QUICK);
    let output = workspace.run(&[]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let table = String::from_utf8(output.stdout).unwrap();
    for word in
        ["sphere.obj", "λ M-PGD", "λ FEM", "angle", "ρ", "verified", "complete", "3 trained"]
    {
        assert!(table.contains(word), "{word} is not in\n{table}");
    }
    assert!(output.stderr.is_empty(), "no bars and no warnings: {table}");
}

#[cfg(target_os = "linux")]
#[test]
fn exit_1_when_the_result_cannot_be_printed() {
    let workspace = Workspace::new(QUICK);
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = workspace.run(&["--format", "json"]).stdout(full).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("could not be printed"));
}

#[test]
fn exit_2_for_usage_and_configuration() {
    let workspace = Workspace::new(QUICK);
    let refused = |arguments: &[&str], message: &str| {
        let output = workspace.run(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(output.stdout.is_empty());
        assert!(text(&output).contains(message), "{message} is not in {}", text(&output));
    };
    refused(&["--set", "train.width_=3"], "did you mean `train.width`?");
    refused(&["--set", "train.k=0"], "must be at least 1");
    refused(
        &["--set", "train.k=-1"],
        "--set train.k=-1: invalid value: integer `-1`, expected a whole number",
    );
    refused(&["--set", "train.width=200000"], "lower it");
    refused(&["--set", "train.tune=3", "--set", "family.members=1"], "raise family.members");
    refused(&["--set", "train.held_out=2"], "leaves no variant to train on");
    refused(&["--set", "train.recipe=none.toml"], "none.toml: ");
    workspace.write("bad.toml", "[train]\nstep = 3\n");
    refused(&["--set", "train.recipe=bad.toml"], "did you mean `train.steps`?");
    refused(&["--jobs", "0"], "'--jobs <N>': a whole number, at least 1");
    refused(&["--memory", "8XB"], "a size such as 500MB or 20GB");
    refused(&["--time-limit", "-1"], "a number of seconds, not negative");
    refused(&["--quick"], "has no [quick]");
    let meshes = workspace.path("meshes");
    let [pipeline, cache] = ["pipeline.toml", "cache"].map(|name| workspace.path(name));
    let [pipeline, cache, out] = [&pipeline, &cache, &meshes].map(|path| path.to_str().unwrap());
    let output = chladni(&["run", pipeline, "--cache", cache, "--out", out]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("the mesh lies there"), "{}", text(&output));
    let sphere = workspace.path("meshes/sphere.obj");
    let output = chladni(&["solve", sphere.to_str().unwrap(), "-k", "3", "--out", out]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("the mesh lies there"), "{}", text(&output));
    let output = chladni(&["watch", out, "--out", out]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("choose another folder"), "{}", text(&output));
    let output = chladni(&["watch", out, "--poll", "0"]);
    assert!(text(&output).contains("a number of seconds, above 0"), "{}", text(&output));
    for (no_pipeline, message) in
        [(&sphere, "it is a mesh: `chladni solve`"), (&meshes, "it is a folder")]
    {
        let output = chladni(&["run", no_pipeline.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(message), "{}", text(&output));
    }
    refused(&["--no-such-flag"], "--no-such-flag");
    let folder = workspace.path("empty");
    std::fs::create_dir(&folder).unwrap();
    refused(&["--input", folder.to_str().unwrap()], "no mesh was found");
    assert_eq!(chladni(&["run", "nowhere.toml"]).status.code(), Some(2));
    assert_eq!(chladni(&[]).status.code(), Some(2));
}

#[test]
fn exit_2_when_another_run_holds_the_cache() {
    let workspace = Workspace::new(QUICK);
    let _held = chladni::store::Store::open(workspace.path("cache")).unwrap();
    let output = workspace.run(&[]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(
        text(&output).contains(&format!("process {}", std::process::id())),
        "{}",
        text(&output)
    );
}

#[test]
fn two_runs_on_one_cache_do_not_meet() {
    let workspace =
        Workspace::new(&QUICK.replace("steps = 4", "steps = 250\nlearning_rate = 1e-4"));
    let mut first = workspace.run(&[]);
    let first = first.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let mut first = first.spawn().unwrap();
    while workspace.events().is_empty() {
        assert!(first.try_wait().unwrap().is_none(), "it ended too early");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let second = workspace.run(&[]).output().unwrap();
    let holder = format!("is in use by process {};", first.id());
    assert_eq!(second.status.code(), Some(2), "{}", text(&second));
    assert!(text(&second).contains(&holder), "{}", text(&second));
    let cache = workspace.path("cache");
    for command in ["stat", "verify", "gc", "clear"] {
        let output = chladni(&["cache", command, "--cache", cache.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{command}: {}", text(&output));
        assert!(text(&output).contains(&holder), "{command}: {}", text(&output));
    }
    let first = first.wait_with_output().unwrap();
    assert_eq!(first.status.code(), Some(0), "{}", text(&first));
    assert_eq!(workspace.report(&[]).1.meshes[0].reused, 3);
}

#[test]
fn exit_2_for_the_cache_of_a_newer_chladni_which_is_left_as_it_is() {
    let workspace = Workspace::new(QUICK);
    workspace.report(&[]);
    workspace.write("cache/chladni.format", "chladni store 3\nof a later day\n");
    let files = || {
        let items = std::fs::read_dir(workspace.path("cache/chladni.sled")).unwrap();
        let mut files: Vec<_> =
            items.map(|item| item.unwrap().path()).filter(|p| p.is_file()).collect();
        files.sort();
        files.into_iter().map(|path| (std::fs::read(&path).unwrap(), path)).collect::<Vec<_>>()
    };
    let before = files();
    let output = workspace.run(&[]).output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(
        text(&output)
            .contains("has format 3, and this chladni knows formats up to 2; update chladni")
    );
    let cache = workspace.path("cache");
    for command in ["stat", "verify", "gc"] {
        let output = chladni(&["cache", command, "--cache", cache.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(2), "{command}: {}", text(&output));
    }
    assert!(files() == before);
}

#[test]
fn what_could_not_be_written_is_tried_again() {
    let workspace = Workspace::new(QUICK);
    std::fs::create_dir(workspace.path("out")).unwrap();
    // A file where the folder of the results has to be.
    workspace.write("out/sphere.obj", "");
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 3, "{report:?}");
    let mut run = workspace.run(&["--retries", "40"]);
    let child = run.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let child = child.spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(1500));
    std::fs::remove_file(workspace.path("out/sphere.obj")).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("it is tried again"), "{}", text(&output));
}

#[test]
fn exit_3_and_the_others_go_on_when_a_mesh_is_broken() {
    let workspace = Workspace::new(QUICK);
    let good = obj(&icosphere(2));
    workspace.write("meshes/a_nan.obj", &good.replacen("v ", "v nan ", 1));
    workspace.write("meshes/b_empty.obj", "");
    workspace.write("meshes/c_range.obj", &format!("{good}f 1 2 9999\n"));
    workspace.write("meshes/d_tiny.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let (code, report) = workspace.report(&["--jobs", "2"]);
    assert_eq!(code, 3);
    let statuses: Vec<Status> = report.meshes.iter().map(|mesh| mesh.status).collect();
    use Status::{Failed, Verified};
    assert_eq!(statuses, [Failed, Failed, Failed, Failed, Verified]);
    let reason = |i: usize| report.meshes[i].reason.clone().unwrap();
    assert!(reason(0).contains("line 1"), "{}", reason(0));
    assert!(reason(2).contains("line 483"), "{}", reason(2));
    assert!(reason(3).contains("ask for fewer"), "{}", reason(3));
    assert!(workspace.path("out/sphere.obj/spectrum.json").exists());
    assert!(!workspace.path("out/a_nan.obj").exists());
}

#[test]
fn several_components_have_one_constant_each_whatever_k() {
    let workspace = Workspace::new(&QUICK.replace("vertices = 90", "vertices = 270"));
    let sphere = icosphere(2);
    let n = sphere.n() as u32;
    let apart =
        |i: u32| sphere.vertices().iter().map(move |&[x, y, z]| [x + f64::from(3 * i), y, z]);
    let faces = |i: u32| sphere.faces().iter().map(move |face| face.map(|v| v + i * n));
    let three = TriMesh::new((0..3).flat_map(apart).collect(), (0..3).flat_map(faces).collect());
    workspace.write("meshes/sphere.obj", &obj(&three.unwrap()));
    for (k, trained) in [(1, 0), (2, 0), (3, 0), (5, 2)] {
        let (code, report) = workspace.report(&["--set", &format!("train.k={k}")]);
        let mesh = &report.meshes[0];
        assert_eq!((code, mesh.trained + mesh.reused), (0, trained), "K = {k}: {:?}", mesh.reason);
        for (j, report) in mesh.eigenpairs.iter().enumerate() {
            assert_eq!(report.pair.lambda.abs() < 1e-9, j < 3, "K = {k}: {report:?}");
        }
        assert!(mesh.completeness.as_ref().unwrap().complete);
    }
}

#[test]
fn a_mesh_that_breaks_does_not_keep_its_old_verdict() {
    let workspace = Workspace::new(QUICK);
    assert_eq!(workspace.report(&[]).0, 0);
    let spectrum = workspace.path("out/sphere.obj/spectrum.json");
    assert!(spectrum.exists() && workspace.path("out/sphere.obj/eigen.ply").exists());
    assert_eq!(workspace.report(&["--set", "publish.formats=[]"]).0, 0);
    assert!(!workspace.path("out/sphere.obj/eigen.ply").exists());
    workspace.write("meshes/sphere.obj", "v 0 0\n");
    assert_eq!(workspace.report(&[]).0, 3);
    assert!(!spectrum.exists());
}

#[test]
fn fail_fast_stops_at_the_first_failure() {
    let workspace = Workspace::new(QUICK);
    workspace.write("meshes/a_broken.obj", "v 0 0\n");
    let (code, report) = workspace.report(&["--fail-fast", "--jobs", "1"]);
    assert_eq!(code, 3);
    assert!(report.meshes[1].reason.as_deref().unwrap().contains("--fail-fast"));
}

#[test]
fn exit_4_when_a_pair_falls_short() {
    let workspace = Workspace::new(QUICK);
    let (code, report) = workspace.report(&["--set", "verify.angle_tolerance=1e-9"]);
    assert_eq!(code, 4);
    assert_eq!(report.meshes[0].status, Status::Unverified);
    assert!(report.meshes[0].reason.as_deref().unwrap().contains("pair 2: angle"));
    // Its results are there all the same, marked as what they are.
    let spectrum = std::fs::read_to_string(workspace.path("out/sphere.obj/spectrum.json")).unwrap();
    assert!(spectrum.contains("\"unverified\""));
}

#[test]
fn the_json_document_is_the_contract() {
    let workspace = Workspace::new(QUICK);
    let output = workspace.run(&["--format", "json"]).output().unwrap();
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let mesh = &document["meshes"][0];
    assert!(document["schema"].is_string() && document["seconds"].is_number());
    for key in [
        "path",
        "hash",
        "status",
        "reason",
        "out",
        "eigenpairs",
        "completeness",
        "trained",
        "reused",
        "seconds",
    ] {
        assert!(mesh.get(key).is_some(), "{key}");
    }
    let pair = &mesh["eigenpairs"][1];
    for key in [
        "k",
        "lambda",
        "lambda_area",
        "source",
        "cluster",
        "residual",
        "rho",
        "lambda_mpgd",
        "lambda_fem",
        "angle_mpgd",
        "angle_fem",
        "cached",
    ] {
        assert!(pair.get(key).is_some(), "{key}");
    }
    for key in ["sigma", "count", "found", "complete", "cut_cluster"] {
        assert!(mesh["completeness"].get(key).is_some(), "{key}");
    }
    assert_eq!(mesh["eigenpairs"][0]["source"], "constant");
    assert_eq!(pair["source"], "trained");
    assert_eq!(pair["k"], 2);
    assert_eq!(mesh["completeness"]["complete"], true);
}

#[test]
fn info_describes_a_mesh_and_refuses_what_is_none() {
    let workspace = Workspace::new(QUICK);
    let sphere = workspace.path("meshes/sphere.obj");
    let output = chladni(&["info", sphere.to_str().unwrap(), "--format", "json"]);
    assert_eq!(output.status.code(), Some(0));
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&info["vertices"], &info["euler"]), (&162.into(), &2.into()));
    let (_, report) = workspace.report(&[]);
    assert_eq!(info["hash"], report.meshes[0].hash.unwrap().to_string());
    let human = chladni(&["info", sphere.to_str().unwrap()]);
    assert!(text(&human).contains("1 component, closed, Euler characteristic 2"));
    workspace.write("meshes/none.obj", "v 0 0 zero\n");
    let refused = chladni(&["info", workspace.path("meshes/none.obj").to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(3));
    assert!(text(&refused).contains("line 1"));
}

/// Three triangles at one edge, one of them twice, and a vertex that none of them uses.
const FIN: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nv 9 9 9\n\
    f 1 2 3\nf 1 2 4\nf 1 2 5\nf 3 2 1\n";

#[test]
fn info_names_every_finding_with_its_treatment_and_its_option() {
    let workspace = Workspace::new(FEM);
    workspace.write("meshes/fin.obj", FIN);
    let fin = workspace.path("meshes/fin.obj");
    let output = chladni(&["info", fin.to_str().unwrap(), "--format", "json"]);
    let info: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let found = info["findings"].as_array().unwrap();
    let whats: Vec<&str> = found.iter().map(|finding| finding["what"].as_str().unwrap()).collect();
    assert_eq!(whats, ["duplicate face", "unreferenced vertex", "non-manifold edge"]);
    assert_eq!(found[0]["first"][0], "line 10");
    assert_eq!(found[2]["first"][0], "0–1");
    assert_eq!((&info["pieces"][0]["genus"], &info["shape"]["angles"][4]), (&().into(), &6.into()));
    let human = text(&chladni(&["info", fin.to_str().unwrap()]));
    for line in human.lines().filter(|line| !line.contains(fin.to_str().unwrap())) {
        assert!(line.chars().count() <= 80, "{line}");
    }
    for said in ["ingest: dropped", "ingest.non_manifold = \"refuse\"", "90°–100° 3 ####"] {
        assert!(human.contains(said), "{said}: {human}");
    }
    // What the options say, a run does.
    let set = ["--set", "ingest.non_manifold=refuse", "--set", "train.k=2"];
    let (exit, report) = workspace.report(&set);
    let reasons: Vec<_> = report.meshes.iter().filter_map(|mesh| mesh.reason.clone()).collect();
    assert_eq!((exit, reasons.len()), (3, 1));
    assert!(reasons[0].contains("1 non-manifold edge"), "{reasons:?}");
    let (exit, _) = workspace.report(&["--set", "operators.robust=tufted", "--set", "train.k=2"]);
    assert_eq!(exit, 0);
}

/// A file with one thing that is not as it should be, what it is called, and words of its meaning and its remedy.
const DEFECTS: [(&str, &str, &str, [&str; 3]); 9] = [
    (
        "pinched.obj",
        "f 1 2 3\nf 1 4 5\n",
        "non-manifold vertex",
        ["0 at (0.0000", "touch", "tufted"],
    ),
    (
        "flipped.obj",
        "f 1 2 3\nf 2 3 4\n",
        "misoriented edge",
        ["1–2", "1 face is inside out", "none changes that"],
    ),
    (
        "moebius.obj",
        "f 1 2 3\nf 2 3 4\nf 3 4 5\nf 4 5 1\nf 5 1 2\n",
        "misoriented edge",
        ["–", "one side", "none changes that"],
    ),
    (
        "collapsed.obj",
        "f 1 2 3\nf 1 1 2\n",
        "collapsed face",
        ["line 7", "named twice", "ingest.degenerate_faces"],
    ),
    (
        "line.obj",
        "f 1 2 3\nf 1 2 6\n",
        "face without area",
        ["line 8", "in a line", "ingest.degenerate_faces"],
    ),
    ("quad.obj", "f 1 2 4 3\n", "polygon", ["line 6", "fan", "none changes that"]),
    (
        "point.obj",
        "f 1 2 3\np 1\n",
        "point, line or two-corner face",
        ["line 7", "left out", "none changes that"],
    ),
    (
        "thin.obj",
        "f 1 2 7\nf 2 1 8\n",
        "negative cotangent weight",
        ["obtuse", "overshoot", "operators.robust"],
    ),
    ("parts.stl", "", "repeated position", ["vertex", "have to repeat", "none changes that"]),
];

#[test]
fn info_tells_of_every_kind_of_defect() {
    let workspace = Workspace::new(FEM);
    // What a face of a case does not use is one more finding.
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 1 1\n";
    for (name, faces, what, said) in DEFECTS {
        let text = match name {
            "parts.stl" => {
                let facet = "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
                format!("solid a\n{facet}{}endsolid a\n", facet.replace("0 1 0", "0 -1 0"))
            }
            "line.obj" => format!("{corners}v 2 0 0\n{faces}"),
            "thin.obj" => format!("{corners}v 9 9 9\nv .5 .1 0\nv .5 -.1 0\n{faces}"),
            _ => format!("{corners}{faces}"),
        };
        workspace.write(name, &text);
        let file = workspace.path(name);
        let info = |more: &[&str]| chladni(&[&["info", file.to_str().unwrap()], more].concat());
        let document: serde_json::Value =
            serde_json::from_slice(&info(&["--format", "json"]).stdout).unwrap();
        let found = document["findings"].as_array().unwrap();
        assert!(found.iter().any(|finding| finding["what"] == what), "{name}: {document}");
        let page = self::text(&info(&[]));
        let at = page.find(what).unwrap_or_else(|| panic!("{name}: {page}"));
        // Long lines are broken.
        let words: Vec<&str> = page[at..].split_whitespace().collect();
        let page = words.join(" ");
        assert!(page.contains("ingest: "), "{name}: {page}");
        for words in said {
            assert!(page.contains(words), "{name}: {words}: {page}");
        }
    }
}

#[test]
fn a_run_says_what_it_has_mended() {
    let workspace = Workspace::new(FEM);
    workspace.write("meshes/sphere.obj", &(obj(&icosphere(2)) + "f 1 1 2\nf 3 3 4\nv 9 9 9\n"));
    let mended = "mended: 2 collapsed faces dropped, 1 unreferenced vertex dropped\n";
    let output = workspace.run(&["--set", "publish.report=true"]).output().unwrap();
    assert!(text(&output).contains(mended), "{}", text(&output));
    let page = workspace.path("out/report.html");
    assert!(text(&output).contains(&format!("; open {}", page.display())), "{}", text(&output));
    let page = std::fs::read_to_string(workspace.path("out/sphere.obj/report.html")).unwrap();
    assert!(page.contains("Mended: 2 collapsed faces dropped"), "{page}");
    let document = std::fs::read(workspace.path("out/sphere.obj/spectrum.json")).unwrap();
    let document: serde_json::Value = serde_json::from_slice(&document).unwrap();
    assert_eq!(
        (&document["repairs"]["collapsed_faces"], &document["repairs"]["polygons"]),
        (&2.into(), &0.into())
    );
    let (_, report) = workspace.report(&[]);
    assert_eq!(report.meshes[0].repairs.as_ref().unwrap().collapsed_faces, 2);
    let sphere = workspace.path("meshes/sphere.obj");
    let solved = chladni(&["solve", sphere.to_str().unwrap(), "-k", "3"]);
    assert!(text(&solved).contains(mended), "{}", text(&solved));
}

#[test]
fn errors_are_log_lines_where_those_are_json() {
    let workspace = Workspace::new(FEM);
    workspace.write("broken.obj", "v 0 \u{1b}[2J 0\n");
    let broken = workspace.path("broken.obj");
    for command in [&["info"][..], &["solve", "-k", "3"], &["solve", "--method", "mpgd"]] {
        let mut arguments = command.to_vec();
        arguments.extend(["--log", "json", broken.to_str().unwrap()]);
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_chladni"));
        // Whatever log lines are asked for, this is said.
        let output = command.args(&arguments).env("RUST_LOG", "off").output().unwrap();
        assert_eq!(output.status.code(), Some(3), "{}", text(&output));
        let line: serde_json::Value = serde_json::from_slice(&output.stderr).unwrap();
        assert_eq!(line["level"], "ERROR");
        assert!(line["message"].as_str().unwrap().contains("broken.obj, line 1"), "{line}");
        assert!(!line["message"].as_str().unwrap().contains('\u{1b}'), "{line}");
    }
    let output = workspace.run(&["--log", "json", "--set", "train.k=0"]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let line: serde_json::Value = serde_json::from_slice(&output.stderr).unwrap();
    assert!(line["message"].as_str().unwrap().contains("train.k"), "{line}");
}

/// What a command prints on a terminal, if this system has `script` to make one.
fn on_a_terminal(workspace: &Workspace, command: &str, no_color: &str) -> Option<String> {
    let script = || std::process::Command::new("script");
    // Others of that name have other options.
    let version = script().arg("--version").output().map(|output| text(&output));
    if !version.is_ok_and(|version| version.contains("util-linux")) {
        eprintln!("skipped: there is no `script` of util-linux");
        return None;
    }
    let output = script()
        .args(["-qec", command, "/dev/null"])
        .current_dir(workspace.path(""))
        .env("NO_COLOR", no_color)
        .env("TERM", "xterm")
        .env_remove("RUST_LOG")
        .env_remove("CHLADNI_LOG")
        .env_remove("CHLADNI_CACHE")
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output));
    Some(text(&output))
}

#[test]
fn a_terminal_has_colours_bars_and_pages_and_no_color_is_kept_to() {
    let workspace = Workspace::new(QUICK);
    let run = format!("'{}' run pipeline.toml", env!("CARGO_BIN_EXE_chladni"));
    let Some(shown) = on_a_terminal(&workspace, &run, "") else { return };
    assert!(shown.contains("\u{1b}[32mverified\u{1b}[0m"), "{shown:?}");
    assert!(shown.contains("/s "), "a bar has its rate: {shown:?}");
    // `auto` is for who sits there.
    assert!(workspace.path("out/report.html").exists());
    let plain = on_a_terminal(&workspace, &run, "1").unwrap();
    assert!(plain.contains("verified") && !plain.contains("\u{1b}[32m"), "{plain:?}");
    workspace.report(&[]);
    assert!(!workspace.path("out/report.html").exists());
}

#[test]
fn patterns_and_lists_are_inputs() {
    let workspace = Workspace::new(FEM);
    for name in ["a_1.obj", "a_2.obj", "b.obj"] {
        workspace.write(&format!("meshes/{name}"), &ellipsoid(1.5));
    }
    workspace.write("meshes/some.lst", "# two\na_2.obj\nb.obj\n");
    let names = |input: &str| -> Vec<String> {
        let input = workspace.path(input);
        let (exit, report) = workspace.report(&["--input", input.to_str().unwrap()]);
        assert_eq!(exit, 0);
        report.meshes.into_iter().filter_map(|mesh| mesh.out).collect()
    };
    let ends = |names: Vec<String>, expected: &[&str]| {
        assert_eq!(names.len(), expected.len(), "{names:?}");
        for (name, end) in names.iter().zip(expected) {
            assert!(name.ends_with(&format!("out/{end}")), "{name}");
        }
    };
    ends(names("meshes/a_?.obj"), &["a_1.obj", "a_2.obj"]);
    ends(names("meshes/some.lst"), &["a_2.obj", "b.obj"]);
    let nothing = workspace.run(&["--input", "none/*.obj"]).output().unwrap();
    assert_eq!(nothing.status.code(), Some(2));
    assert!(text(&nothing).contains("none/*.obj matches no mesh"));
}

#[test]
fn generated_meshes_are_the_surfaces_that_they_are_called_after() {
    let workspace = Workspace::new(FEM);
    let generate = |arguments: &[&str], file: &str| {
        let out = workspace.path(file);
        let out = ["--out", out.to_str().unwrap()];
        chladni(&[&["generate"], arguments, &out].concat())
    };
    let output = generate(&["sphere", "--vertices", "600", "--seed", "2"], "meshes/generated.ply");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let (_, report) = workspace.report(&[]);
    let sphere = report.meshes.iter().find(|mesh| mesh.path == "generated.ply").unwrap();
    // l(l + 1) = 2, three times.
    assert!(sphere.eigenpairs[1..].iter().all(|pair| (pair.pair.lambda / 2.0 - 1.0).abs() < 0.02));
    let output = generate(&["square", "--vertices", "40", "--count", "12"], "squares/train.obj");
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let files = std::fs::read_dir(workspace.path("squares")).unwrap();
    let mut names: Vec<_> = files.map(|file| file.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names.len(), 12);
    assert_eq!(names[7], "train-07.obj");
    for (arguments, file, reason) in [
        (["torus", "--vertices", "3"], "a.ply", "a torus takes 60 vertices or more, and not 3"),
        (["vase", "--vertices", "90"], "a.stl", "a mesh is written as .ply or .obj"),
        (["cube", "--vertices", "90"], "a.ply", "there are square, sphere, torus, vase"),
    ] {
        let output = generate(&arguments, file);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(reason), "{}", text(&output));
    }
}

#[test]
fn a_pipeline_generates_its_meshes() {
    let entry = |entry: &str| FEM.replace("paths = [\"meshes\"]", &format!("generate = [{entry}]"));
    let two = "{ shape = \"sphere\", vertices = [100, 200], count = 2 }";
    let one = "{ shape = \"torus\", vertices = [150], seed = 3 }";
    let workspace = Workspace::new(&entry(&format!("{two}, {one}")));
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0, "{report:?}");
    let names: Vec<_> = report.meshes.iter().map(|mesh| mesh.path.as_str()).collect();
    let expected = [
        "sphere-100-0.ply",
        "sphere-100-1.ply",
        "sphere-200-0.ply",
        "sphere-200-1.ply",
        "torus-150-seed3.ply",
    ];
    assert_eq!(names, expected);
    assert_eq!(report.meshes.iter().map(|mesh| mesh.vertices.unwrap()).sum::<usize>(), 750);
    let written = |name: &str| {
        let file = workspace.path("out/generated").join(name);
        file.metadata().unwrap().modified().unwrap()
    };
    let before = expected.map(written);
    let (_, again) = workspace.report(&[]);
    assert!(again.meshes.iter().zip(&report.meshes).all(|(a, b)| a.hash == b.hash));
    assert_eq!(expected.map(written), before);
    // Meshes on the command line take their place.
    let meshes = workspace.path("meshes");
    let (_, report) = workspace.report(&["--input", meshes.to_str().unwrap()]);
    assert_eq!(report.meshes.len(), 1);
    for (bad, reason) in [
        ("{ shape = \"sphere\", vertices = [3] }", "a sphere takes 12 vertices or more, and not 3"),
        ("{ shape = \"sphere\", vertices = [30, 30] }", "sphere-30.ply is asked for twice"),
        ("{ shape = \"sphere\", vertice = [30] }", "unknown field `vertice`"),
        ("{ shape = \"cube\", vertices = [30] }", "unknown variant `cube`"),
    ] {
        workspace.write("pipeline.toml", &entry(bad));
        let output = workspace.run(&[]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(reason), "{}", text(&output));
    }
}

#[test]
fn cache_stat_counts_what_a_run_left() {
    let workspace = Workspace::new(QUICK);
    workspace.report(&[]);
    let cache = workspace.path("cache");
    let output =
        chladni(&["cache", "stat", "--cache", cache.to_str().unwrap(), "--format", "json"]);
    let stat: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(stat["stages"]["train"]["entries"], 3);
    assert_eq!(stat["stages"]["assemble"]["entries"], 3);
    let human = chladni(&["cache", "stat", "--cache", cache.to_str().unwrap()]);
    assert!(text(&human).contains("train"));
    assert_eq!(chladni(&["cache", "stat", "--cache", "nowhere"]).status.code(), Some(2));
}

#[test]
fn help_lists_the_exit_codes() {
    let help = text(&chladni(&["--help"]));
    assert!(help.contains("130  interrupted") && help.contains("4    some eigenpair"));
}

#[test]
fn shells_and_manual_readers_get_what_they_need_from_the_command_line_itself() {
    let bash = chladni(&["completions", "bash"]);
    let script = String::from_utf8_lossy(&bash.stdout);
    assert!(bash.status.success() && script.contains("_chladni()"), "{script}");
    assert!(script.contains("--dry-run") && script.contains("generate"), "{script}");
    let page = chladni(&["man"]);
    assert!(String::from_utf8_lossy(&page.stdout).starts_with(".ie"), "{}", text(&page));
    let dir = tempfile::tempdir().unwrap();
    let written = chladni(&["man", "--out", dir.path().to_str().unwrap()]);
    assert!(written.status.success(), "{}", text(&written));
    for name in ["chladni", "chladni-run", "chladni-model-export", "chladni-cache-gc"] {
        let page = std::fs::read_to_string(dir.path().join(format!("{name}.1"))).unwrap();
        for part in ["SYNOPSIS", ".SH \"EXAMPLES\"\n.nf\n  chladni ", ".SH \"EXIT STATUS\""] {
            assert!(page.contains(part), "{name}: {part}: {page}");
        }
        assert!(page.contains(concat!("chladni ", env!("CARGO_PKG_VERSION"))), "{name}: {page}");
    }
}

#[test]
fn options_are_explained_one_by_one_all_together_and_to_editors() {
    let all = chladni(&["options"]);
    let file = String::from_utf8(all.stdout).unwrap();
    let parsed = chladni::pipeline::Pipeline::parse("options", &file, &[]);
    assert_eq!(parsed, Ok(chladni::pipeline::Pipeline::default()));
    let one = chladni(&["options", "train.layer"]);
    let one = String::from_utf8(one.stdout).unwrap();
    assert!(one.contains("\"sggc\": ") && one.ends_with("layer = \"pointwise\"\n"), "{one}");
    assert!(file.contains(&one), "{one}");
    let schema = chladni(&["options", "--schema"]);
    let schema: serde_json::Value = serde_json::from_slice(&schema.stdout).unwrap();
    for section in ["input", "train", "sweep", "variant", "quick"] {
        assert!(schema["properties"][section].is_object(), "{section}");
    }
    let unknown = chladni(&["options", "train.widht"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown).contains("did you mean `train.width`?"), "{}", text(&unknown));
}

#[test]
fn log_lines_are_json_on_request() {
    let workspace = Workspace::new(FEM);
    let output = workspace
        .run(&["--log", "json", "--format", "json"])
        .env("RUST_LOG", "debug,sled=off")
        .output()
        .unwrap();
    let lines = String::from_utf8(output.stderr).unwrap();
    assert!(lines.lines().count() > 0, "{lines}");
    for line in lines.lines() {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(line["level"].is_string() && line["message"].is_string(), "{line}");
    }
    serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap();
}
