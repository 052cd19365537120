//! `docs/paper.md` from what the experiments of the paper have left: numbers, pictures, and how fast a prediction is.
//!
//! ```sh
//! for x in fig3 fig4 fig5 fig6 fig7 fig8 fig9 table1 table2 table3; do
//!     chladni run pipelines/paper/$x.toml --out out/paper/$x
//! done
//! cargo bench --bench paper -- out/paper
//! ```
//! The text around them is `docs/paper/template.md`: `{{table fig3}}` becomes a table, `{{pictures fig3}}` one of pictures,
//! `{{plot fig5}}` a plot, `{{speed}}` what is measured here and now. `--keep-speed` takes that from the page as it is. An experiment that
//! was not run is said to be missing.
//!
//! - `results`: what a sweep has left
//! - `pictures`: eigenfunctions in the paper's arrangement
//! - `plot`: errors by k
//! - `speed`: a prediction beside assembly and solver

mod pictures;
mod plot;
mod results;
mod speed;
#[path = "../untrained/mod.rs"]
mod untrained;

use std::error::Error;
use std::path::{Path, PathBuf};

use results::Experiment;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let keep_speed = arguments.iter().any(|a| a == "--keep-speed");
    let out = arguments.iter().find(|a| !a.starts_with("--")).map_or("out/paper", String::as_str);
    let (out, docs) = (PathBuf::from(out), Path::new(env!("CARGO_MANIFEST_DIR")).join("docs"));
    let page = docs.join("paper.md");
    let before = std::fs::read_to_string(&page).unwrap_or_default();
    let template = std::fs::read_to_string(docs.join("paper/template.md"))?;
    let mut text = String::from(GENERATED);
    for (i, part) in template.split("{{").enumerate() {
        let Some((order, rest)) = part.split_once("}}").filter(|_| i > 0) else {
            text += part;
            continue;
        };
        let filled = match order.split_once(' ') {
            Some(("table", name)) => Experiment::read(&out, name).map(|e| e.table()),
            Some(("pictures", name)) => {
                Experiment::read(&out, name).and_then(|e| pictures::of(&e, &docs))
            }
            Some(("plot", name)) => Experiment::read(&out, name).and_then(|e| plot::of(&e, &docs)),
            None if order == "speed" && keep_speed => kept(&before),
            None if order == "speed" => Ok(speed::table()),
            _ => Err(format!("docs/paper/template.md: nothing is called {order:?}").into()),
        };
        text += &filled.unwrap_or_else(|error| {
            eprintln!("{order}: {error}");
            format!("*Missing: {order} ({error}).*\n")
        });
        text += rest;
    }
    std::fs::write(&page, text)?;
    println!("{}", page.display());
    Ok(())
}

const GENERATED: &str =
    "<!-- Made by `cargo bench --bench paper` from docs/paper/template.md: edit that. -->\n\n";

/// The table of times in the page as it is.
fn kept(page: &str) -> Outcome<String> {
    let start = page.find(speed::HEADER).ok_or("the page has no times yet")?;
    let lines = page[start..].lines().take_while(|line| line.starts_with('|'));
    Ok(lines.map(|line| format!("{line}\n")).collect())
}
