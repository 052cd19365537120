//! The documentation holds what the code does.

use chladni::descriptors::Descriptor;
use chladni::mesh::Format;
use chladni::pipeline::{ExportFormat, Pipeline, reference};
use chladni::publish::export::files;

/// A page with a TOML block that is made of the code: the one below the comment that names it.
fn with_block(page: &str, name: &str, block: &str) -> String {
    let mark =
        format!("<!-- {name}: written by UPDATE_DOCS=1 cargo test --test docs -->\n```toml\n");
    let (before, rest) = page.split_once(&mark).unwrap();
    let (_, after) = rest.split_once("```").unwrap();
    format!("{before}{mark}{block}```{after}")
}

#[test]
fn the_reference_page_is_what_the_code_says() {
    let page = std::fs::read_to_string("docs/pipeline.md").unwrap();
    let made = with_block(&page, "options", &reference::defaults());
    let made = with_block(&made, "sweep", &reference::sweep());
    if std::env::var_os("UPDATE_DOCS").is_some() {
        std::fs::write("docs/pipeline.md", &made).unwrap();
    } else {
        assert_eq!(page, made, "docs/pipeline.md is old: UPDATE_DOCS=1 cargo test --test docs");
    }
}

#[test]
fn every_option_has_its_default_and_a_meaning() {
    let text = reference::defaults();
    assert_eq!(Pipeline::parse("defaults", &text, &[]), Ok(Pipeline::default()));
    for (section, keys) in toml::Table::try_from(Pipeline::default()).unwrap() {
        for key in keys.as_table().unwrap().keys() {
            let about = reference::about(&format!("{section}.{key}")).unwrap();
            let (meaning, option): (Vec<&str>, Vec<&str>) =
                about.lines().partition(|line| line.starts_with("# "));
            assert!(!meaning.is_empty(), "{section}.{key} has no meaning");
            assert!(option[0].starts_with(&format!("{key} = ")), "{section}.{key}: {option:?}");
        }
    }
}

#[test]
fn a_name_that_no_option_has_is_answered_with_the_nearest() {
    let refused = reference::about("train.layerz").unwrap_err().to_string();
    assert!(refused.ends_with("did you mean `train.layer`?"), "{refused}");
}

#[test]
fn every_pipeline_that_is_shipped_loads() {
    for entry in std::fs::read_dir("pipelines").unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let pipeline = Pipeline::load(&path, &[]).unwrap();
            for input in &pipeline.input.paths {
                assert!(input.exists(), "{}: {} is missing", path.display(), input.display());
            }
        }
    }
}

#[test]
fn every_list_of_formats_is_whole() {
    let lists = [
        ("docs/pipeline.md", Format::listed(Format::extension)),
        ("src/cli/single.rs", Format::listed(Format::name)),
        ("README.md", Format::listed(Format::name)),
    ];
    for (file, list) in lists {
        let text = std::fs::read_to_string(file).unwrap().replace("\n# ", " ");
        assert!(text.contains(&list), "{file} does not say {list}");
    }
}

#[test]
fn every_file_that_is_written_is_described() {
    let page = std::fs::read_to_string("docs/outputs.md").unwrap();
    let names = ExportFormat::ALL.into_iter().flat_map(files);
    for name in names.chain(["descriptors.npz", "shape_dna.csv", "shape_dna_distances.csv"].iter())
    {
        assert!(page.contains(&format!("`{name}`")), "docs/outputs.md does not describe {name}");
    }
    for descriptor in Descriptor::ALL {
        assert!(page.contains(&format!("`{}`", descriptor.name())), "{}", descriptor.name());
    }
}
