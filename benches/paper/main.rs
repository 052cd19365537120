//! `docs/paper.md` from what the experiments of the paper have left: numbers, pictures, and how fast a prediction is.
//!
//! ```sh
//! for x in fig3 fig4 fig5 fig6 fig7 fig8 fig9 table1 table2 table3; do
//!     chladni run pipelines/paper/$x.toml --out out/paper/$x
//! done
//! cargo bench --bench paper -- out/paper
//! ```
//! The text around them is `docs/paper/template.md`: `{{table fig3}}` becomes a table, `{{pictures fig3}}` one of pictures,
//! `{{plot fig5}}` a plot, `{{speed}}` what is measured here and now, unless `--keep-speed` is given. What was not run stays as the
//! page has it; rows of tables that were not run come from `docs/paper/results`. So one experiment, or one variant, can be run again alone.
//!
//! - `results`: what a sweep has left
//! - `rows`: the rows of its table, and those of earlier runs
//! - `pictures`: eigenfunctions in the paper's arrangement
//! - `plot`: errors by k
//! - `speed`: a prediction beside assembly and solver

mod pictures;
mod plot;
mod results;
mod rows;
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
        let experiment = |name| Experiment::read(&out, name);
        let filled = match order.split_once(' ') {
            Some(("table", name)) => rows::table(experiment(name), &docs, name),
            Some(("pictures", name)) => experiment(name).and_then(|e| pictures::of(&e, &docs)),
            Some(("plot", name)) => experiment(name).and_then(|e| plot::of(&e, &docs)),
            None if order == "speed" && keep_speed => Err("kept".into()),
            None if order == "speed" => Ok(speed::table()),
            _ => Err(format!("docs/paper/template.md: nothing is called {order:?}").into()),
        };
        let begin = begin(order);
        let filled = filled.or_else(|error| {
            eprintln!("{order}: {error}; the page keeps what it has");
            kept(&before, &begin).ok_or(error)
        });
        let filled = filled.unwrap_or_else(|error| format!("*Missing: {order} ({error}).*\n"));
        text += &format!("{begin}{filled}{END}{rest}");
    }
    std::fs::write(&page, text)?;
    println!("{}", page.display());
    Ok(())
}

const GENERATED: &str =
    "<!-- Made by `cargo bench --bench paper` from docs/paper/template.md: edit that. -->\n\n";

/// The line that a filled part begins with.
fn begin(order: &str) -> String {
    format!("<!-- {order} -->\n\n")
}

/// What a filled part ends with.
const END: &str = "\n<!-- end -->";

/// A part of the page as it is.
fn kept(page: &str, begin: &str) -> Option<String> {
    let (_, rest) = page.split_once(begin)?;
    Some(rest.split_once(END)?.0.into())
}
