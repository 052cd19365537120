//! The documentation holds what the code does.

use chladni::descriptors::Descriptor;
use chladni::mesh::Format;
use chladni::pipeline::{ExportFormat, Pipeline};
use chladni::publish::export::files;

/// The first TOML block of `docs/pipeline.md`: every option with its default.
fn documented() -> String {
    let page = std::fs::read_to_string("docs/pipeline.md").unwrap();
    let block = page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    block.unwrap().to_string()
}

#[test]
fn the_reference_page_has_every_option_with_its_default() {
    let text = documented();
    let pipeline = Pipeline::parse("docs/pipeline.md", &text, &[]).unwrap();
    assert_eq!(pipeline, Pipeline::default());
    let documented: toml::Table = text.parse().unwrap();
    let options = toml::Table::try_from(Pipeline::default()).unwrap();
    for (section, keys) in &options {
        for key in keys.as_table().unwrap().keys() {
            let described = documented.get(section).and_then(|section| section.get(key));
            assert!(described.is_some(), "docs/pipeline.md does not describe {section}.{key}");
        }
    }
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
        let text = std::fs::read_to_string(file).unwrap();
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
