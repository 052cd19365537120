//! `report.html` in a browser: no errors, a mesh that turns by keys and mouse, other eigenfunctions by buttons. Without Chromium the
//! browser's part is left out, with a message.

mod common;

use std::collections::BTreeSet;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::{QUICK, Workspace, text};
use serde_json::Value;

/// What a reader would do, and what came of it as JSON in the page. Errors are collected from before anything else runs.
/// Under virtual time frames come late: they are timers here.
const FIRST: &str = "<script>window.found = []; window.requestAnimationFrame = (f) => setTimeout(f, 0); addEventListener('error', (e) => found.push(e.message));\
    console.error = (...words) => found.push(words.join(' '));
    const told = (more) => {
      const result = { found, ...more, wide: document.documentElement.scrollWidth - innerWidth,
        links: [...document.querySelectorAll('[src],[href]')].map((e) => (e.getAttribute('src') || e.getAttribute('href')).slice(0, 30)) };
      document.body.innerHTML = '<pre id=result>' + btoa(unescape(encodeURIComponent(JSON.stringify(result)))) + '</pre>';
    };</script>";
const THEN: &str = r"<script>
addEventListener('load', async () => {
  const canvas = document.getElementById('mesh');
  const later = async () => { for (let i = 0; i < 6; i++) await new Promise((done) => setTimeout(done, 60)); };
  const look = async () => {
    await later();
    const gl = canvas.getContext('webgl2');
    const pixels = new Uint8Array(canvas.width * canvas.height * 4);
    gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let [sum, seen] = [0, 0];
    for (let i = 0; i < pixels.length; i += 4) {
      seen += pixels[i + 3] > 0 ? 1 : 0;
      sum = (sum * 31 + pixels[i] + 7 * pixels[i + 1] + 13 * pixels[i + 2]) % 1000003;
    }
    return [sum, seen / (canvas.width * canvas.height)];
  };
  const key = (name) => canvas.dispatchEvent(new KeyboardEvent('keydown', { key: name, bubbles: true }));
  const mouse = (kind, x, y) =>
    canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: y, bubbles: true }));
  canvas.setPointerCapture = () => {};
  const looks = [await look()];
  key('ArrowRight'); looks.push(await look());
  key('0'); looks.push(await look());
  mouse('pointerdown', 10, 10); mouse('pointermove', 60, 30); mouse('pointerup', 60, 30);
  looks.push(await look());
  key('0'); key('n'); looks.push(await look());
  const shown = document.getElementById('shown').textContent;
  document.querySelectorAll('[data-function]')[0].click(); looks.push(await look());
  told({ looks, shown, buttons: document.querySelectorAll('[data-function]').length });
});
</script>";

/// A page that is looked at, and no more.
const LOOK: &str = "<script>addEventListener('load', () => told({}));</script>";

/// A page with its mesh turned, and another eigenfunction on it.
const TURN: &str = r"<script>
addEventListener('load', () => {
  const canvas = document.getElementById('mesh');
  for (const key of ['ArrowRight', 'ArrowRight', 'ArrowRight', 'ArrowDown', 'ArrowDown', 'n'])
    canvas.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
});
</script>";

fn browser() -> Option<&'static str> {
    ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success()))
}

/// A copy of the page beside it, in which something happens.
fn with_script(page: &Path, name: &str, script: &str) -> PathBuf {
    let html = std::fs::read_to_string(page).unwrap();
    let html = html.replace("<head>", &format!("<head>{FIRST}"));
    let copy = page.with_file_name(name);
    std::fs::write(&copy, html.replace("</body>", script)).unwrap();
    copy
}

/// The size of a window.
type Window = (u32, u32);

/// A visit to the page.
fn visit(browser: &str, page: &Path, (width, height): Window, arguments: &[&str]) -> Output {
    let profile = tempfile::tempdir().unwrap();
    Command::new(browser)
        .args(["--headless", "--no-sandbox", "--use-angle=swiftshader"])
        .args(["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-first-run"])
        .args(["--disable-quic", "--disable-background-networking", "--disable-component-update"])
        .args(["--disable-sync", "--hide-scrollbars", "--virtual-time-budget=20000"])
        .args(arguments)
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},{height}"))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap()
}

/// Takes a picture of the page as people see it who like it dark or light, left in `target/tmp` to be looked at: its colours, and that
/// of its corner.
fn screenshot(
    browser: &str,
    page: &Path,
    name: &str,
    window @ (width, _): Window,
    dark: bool,
) -> (BTreeSet<[u8; 3]>, [u8; 3]) {
    let scheme = if dark { "dark" } else { "light" };
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{width}-{scheme}.png"));
    let picture = format!("--screenshot={}", file.display());
    let preferred = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
    let output = visit(browser, page, window, &[&picture, &preferred]);
    let picture = std::fs::File::open(&file).unwrap_or_else(|_| panic!("{}", text(&output)));
    let mut reader = png::Decoder::new(BufReader::new(picture)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((info.width, info.height), window);
    let pixel = |bytes: &[u8]| [bytes[0], bytes[1], bytes[2]];
    let colours = bytes.chunks_exact(info.color_type.samples()).map(pixel);
    (colours.collect(), pixel(&bytes))
}

/// What the page came to at this width.
fn visited(browser: &str, page: &Path, width: u32) -> Value {
    let output = visit(browser, page, (width, 900), &["--dump-dom"]);
    let page = String::from_utf8_lossy(&output.stdout);
    let result = page.split("<pre id=\"result\">").nth(1).and_then(|rest| rest.split('<').next());
    let result = result.unwrap_or_else(|| panic!("no result: {}", text(&output)));
    use base64::Engine;
    let bytes = base64::engine::general_purpose::STANDARD.decode(result).unwrap();
    let seen: Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!(seen["found"], serde_json::json!([]), "at {width}");
    assert!(seen["wide"].as_f64().unwrap() <= 0.0, "nothing sticks out at {width}: {seen}");
    seen
}

/// Prints the page, left in `target/tmp`, and counts its pictures.
fn printed_pictures(browser: &str, page: &Path) -> usize {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("report.pdf");
    let output =
        visit(browser, page, (1200, 900), &[&format!("--print-to-pdf={}", file.display())]);
    let pdf = std::fs::read(&file).unwrap_or_else(|_| panic!("{}", text(&output)));
    assert!(pdf.starts_with(b"%PDF"));
    pdf.windows(15).filter(|window| window == b"/Subtype /Image").count()
}

#[test]
fn pages_are_there_when_they_are_asked_for_and_work_in_a_browser() {
    let workspace = Workspace::new(QUICK);
    workspace.write("meshes/broken.obj", "v 0 0\n");
    let out = |name: &str| -> PathBuf { workspace.path("out").join(name) };
    let (_, report) = workspace.report(&["--set", "publish.report=true"]);
    assert_eq!(report.meshes.len(), 2);
    let run = std::fs::read_to_string(out("report.html")).unwrap();
    assert!(run.contains("sphere.obj/report.html"), "{run}");
    assert!(run.contains("broken.obj") && run.contains("Failed"), "{run}");
    for part in [
        "How it came about",
        "<li class=\"\">train<small>",
        "The command:",
        "publish.report=true",
        " run ",
        "pipeline.toml",
    ] {
        assert!(run.contains(part), "{part}: {run}");
    }
    let page = std::fs::read_to_string(out("sphere.obj/report.html")).unwrap();
    let parts = [
        "<li class=\"\">train φ2 … φ4<small>",
        "Eigenpairs",
        "<td class=\"text good\">verified</td>",
        "Nodal lines",
        "src=\"data:image/png;base64,",
        "Spectrum",
        "Weyl: 4πk",
        "M-PGD",
        "Errors",
        "angle to FEM",
        "Training, relative to its end",
        "The command:",
        "publish.report=true",
        &report.meshes[1].hash.unwrap().to_string(),
    ];
    for part in parts {
        assert!(page.contains(part), "{part}");
    }
    for asks_for in ["src=\"http", "href=\"http", "url(http", "import "] {
        assert!(!page.contains(asks_for), "it needs no network: {asks_for}");
    }

    if let Some(browser) = browser() {
        let page = out("sphere.obj/report.html");
        let copy = with_script(&page, "visited.html", THEN);
        let turned = with_script(&page, "turned.html", TURN);
        let of_run = with_script(&out("report.html"), "looked-at.html", LOOK);
        assert!(printed_pictures(browser, &page) >= 3, "eigenfunctions are printed");
        let window = (1200, 900);
        let as_it_was = screenshot(browser, &page, "as-it-was", window, true);
        assert_ne!(screenshot(browser, &turned, "turned", window, true), as_it_was);
        for (width, height) in [(1200, 2400), (400, 3600)] {
            screenshot(browser, &out("report.html"), "run", (width, 900), width == 400);
            let links = visited(browser, &of_run, width)["links"].clone();
            assert_eq!(links, serde_json::json!(["data:,", "sphere.obj/report.html"]));
            let seen = visited(browser, &copy, width);
            let look =
                |i: usize| (seen["looks"][i][0].clone(), seen["looks"][i][1].as_f64().unwrap());
            assert!(look(0).1 > 0.1, "the mesh is seen: {seen}");
            assert_ne!(look(1).0, look(0).0, "a key turns it: {seen}");
            assert_eq!(look(2).0, look(0).0, "and another turns it back: {seen}");
            assert_ne!(look(3).0, look(0).0, "so does the mouse: {seen}");
            assert_ne!(look(4).0, look(0).0, "the next eigenfunction looks different: {seen}");
            assert_eq!(look(5).0, look(0).0, "a button shows the first again: {seen}");
            assert!(seen["shown"].as_str().unwrap().starts_with("φ3, λ = "), "{seen}");
            assert_eq!(seen["buttons"], 3);
            let links = seen["links"].as_array().unwrap();
            assert!(links.iter().all(|link| link.as_str().unwrap().starts_with("data:")), "{seen}");
            for (dark, corner) in [(true, 0..64), (false, 192..256)] {
                let (colours, first) = screenshot(browser, &page, "report", (width, height), dark);
                assert!(first.iter().all(|&c| corner.contains(&i32::from(c))), "{first:?}");
                assert!(colours.len() > 500, "a shaded mesh has many colours: {}", colours.len());
            }
        }
    } else {
        eprintln!("Chromium is not here: the page was not opened");
    }

    // What comes from the cache is drawn so.
    workspace.report(&["--set", "publish.report=true"]);
    for page in ["report.html", "sphere.obj/report.html"] {
        let page = std::fs::read_to_string(out(page)).unwrap();
        assert!(page.contains("<li class=\"cached\">train"), "{page}");
        assert!(page.contains(", from the cache"), "{page}");
    }

    // For programs there are none, unless they are asked for.
    workspace.report(&[]);
    assert!(!out("report.html").exists() && !out("sphere.obj/report.html").exists());
}
