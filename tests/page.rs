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
    console.error = (...words) => found.push(words.join(' '));</script>";
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
  const result = { found, looks, shown, buttons: document.querySelectorAll('[data-function]').length,
    wide: document.documentElement.scrollWidth - innerWidth,
    links: [...document.querySelectorAll('[src],[href]')].map((e) => (e.src || e.href).slice(0, 30)) };
  document.body.innerHTML = '<pre id=result>' + btoa(unescape(encodeURIComponent(JSON.stringify(result)))) + '</pre>';
});
</script>";

fn browser() -> Option<&'static str> {
    ["chromium", "chromium-browser", "google-chrome"]
        .into_iter()
        .find(|name| Command::new(name).arg("--version").output().is_ok_and(|o| o.status.success()))
}

/// A visit to the page at this width.
fn visit(browser: &str, page: &Path, width: u32, arguments: &[&str]) -> Output {
    let profile = tempfile::tempdir().unwrap();
    Command::new(browser)
        .args(["--headless", "--no-sandbox", "--use-angle=swiftshader"])
        .args(["--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", "--no-first-run"])
        .args(["--disable-quic", "--disable-background-networking", "--disable-component-update"])
        .args(["--disable-sync", "--hide-scrollbars", "--virtual-time-budget=20000"])
        .args(arguments)
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--window-size={width},900"))
        .arg(format!("file://{}", page.display()))
        .output()
        .unwrap()
}

/// Takes a picture of the page as people see it who like it dark or light, left in `target/tmp` to be looked at: its colours, and that
/// of its corner.
fn screenshot(browser: &str, page: &Path, width: u32, dark: bool) -> (BTreeSet<[u8; 3]>, [u8; 3]) {
    let scheme = if dark { "dark" } else { "light" };
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("report-{width}-{scheme}.png"));
    let picture = format!("--screenshot={}", file.display());
    let preferred = format!("--blink-settings=preferredColorScheme={}", u8::from(!dark));
    let output = visit(browser, page, width, &[&picture, &preferred]);
    let picture = std::fs::File::open(&file).unwrap_or_else(|_| panic!("{}", text(&output)));
    let mut reader = png::Decoder::new(BufReader::new(picture)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert!(info.width == width && info.height == 900, "{info:?}");
    let pixel = |bytes: &[u8]| [bytes[0], bytes[1], bytes[2]];
    let colours = bytes.chunks_exact(info.color_type.samples()).map(pixel);
    (colours.collect(), pixel(&bytes))
}

/// What the page came to at this width.
fn visited(browser: &str, page: &Path, width: u32) -> Value {
    let output = visit(browser, page, width, &["--dump-dom"]);
    let page = String::from_utf8_lossy(&output.stdout);
    let result = page.split("<pre id=\"result\">").nth(1).and_then(|rest| rest.split('<').next());
    let result = result.unwrap_or_else(|| panic!("no result: {}", text(&output)));
    use base64::Engine;
    let bytes = base64::engine::general_purpose::STANDARD.decode(result).unwrap();
    serde_json::from_slice(&bytes).unwrap()
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
    let page = std::fs::read_to_string(out("sphere.obj/report.html")).unwrap();
    for part in ["Eigenpairs", "Nodal lines", "train φ2 … φ4", "The command:", "Weyl", "<svg"] {
        assert!(page.contains(part), "{part}");
    }
    for asks_for in ["src=\"http", "href=\"http", "url(http", "import "] {
        assert!(!page.contains(asks_for), "it needs no network: {asks_for}");
    }

    if let Some(browser) = browser() {
        let page = page.replace("<head>", &format!("<head>{FIRST}")).replace("</body>", THEN);
        let copy = out("sphere.obj/visited.html");
        std::fs::write(&copy, page).unwrap();
        for width in [1200, 400] {
            let seen = visited(browser, &copy, width);
            assert_eq!(seen["found"], serde_json::json!([]), "at {width}");
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
                let (colours, first) =
                    screenshot(browser, &out("sphere.obj/report.html"), width, dark);
                assert!(first.iter().all(|&c| corner.contains(&i32::from(c))), "{first:?}");
                assert!(colours.len() > 500, "a shaded mesh has many colours: {}", colours.len());
            }
            assert!(seen["wide"].as_f64().unwrap() <= 0.0, "nothing sticks out at {width}: {seen}");
        }
    } else {
        eprintln!("Chromium is not here: the page was not opened");
    }

    // For programs there are none, unless they are asked for.
    workspace.report(&[]);
    assert!(!out("sphere.obj/report.html").exists());
}
