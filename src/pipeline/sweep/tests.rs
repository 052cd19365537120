//! What a file with variants becomes.

use super::super::RecipeName;
use super::*;

fn read(text: &str, set: &[&str], effort: Effort) -> Result<Sweep, PipelineError> {
    let assignments: Vec<String> = set.iter().map(ToString::to_string).collect();
    let asked = Asked { assignments: &assignments, effort, variants: &[] };
    Sweep::read("s.toml", text, asked, Path::new(""))
}

const TWO: &str = "
    [train]
    k = 3
    width = 32
    [sweep]
    title = \"Two\"
    seeds = [4, 5]
    columns = [{ name = \"error\", what = \"mse\", k = 1 }, { name = \"mean\", what = \"rmse\", k = [1, 3], of = \"fem\" }]
    [[variant]]
    name = \"by the paper\"
    train = { recipe = \"paper\", epochs = 9 }
    printed = { error = 5e-6 }
    [[variant]]
    name = \"wide: 64\"
    seeds = [7]
    train.width = 64
    [quick]
    train = { width = 8, steps = 2, epochs = 1 }
";

#[test]
fn every_variant_is_a_pipeline_for_every_seed() {
    let Sweep { comparison, cases } = read(TWO, &["train.k=2"], Effort::Full).unwrap();
    let shown: Vec<_> = cases
        .iter()
        .map(|case| {
            let train = &case.pipeline.train;
            assert_eq!((train.seed, train.k), (case.seed, 2.into()));
            (case.folder().display().to_string(), train.recipe, train.width)
        })
        .collect();
    assert_eq!(
        shown,
        [
            ("by-the-paper/seed-4".to_string(), RecipeName::Paper, 32),
            ("by-the-paper/seed-5".to_string(), RecipeName::Paper, 32),
            ("wide-64/seed-7".to_string(), RecipeName::Ritz, 64),
        ]
    );
    let Comparison { columns, variants, .. } = comparison.unwrap();
    assert_eq!((columns[1].of, columns[1].k), (Whose::Fem, Places::Range([1, 3])));
    assert!(columns[1].k.has(3) && !columns[0].k.has(2));
    assert_eq!(variants[0].printed["error"], 5e-6);
}

#[test]
fn of_the_others_nothing_is_read_when_some_are_asked_for() {
    let (assignments, variants) = (["train.epochs=4".into()], ["by the paper".into()]);
    let asked = Asked { assignments: &assignments, variants: &variants, ..Asked::default() };
    let read = |asked| Sweep::read("s.toml", TWO, asked, Path::new(""));
    let Sweep { comparison, cases } = read(asked).unwrap();
    assert_eq!((comparison.unwrap().variants.len(), cases.len()), (1, 2));
    assert!(cases.iter().all(|case| case.pipeline.train.epochs == 4));
    assert!(read(Asked { variants: &[], ..asked }).is_err(), "the other has no epochs");
    let message = read(Asked { variants: &["c".into()], ..asked }).unwrap_err().to_string();
    assert!(message.contains("\"by the paper\", \"wide: 64\""), "{message}");
}

#[test]
fn a_rehearsal_takes_one_seed_and_what_is_quick() {
    let cases = read(TWO, &[], Effort::Quick).unwrap().cases;
    let shown: Vec<_> = cases
        .iter()
        .map(|Case { seed, pipeline: Pipeline { train, .. }, .. }| {
            (*seed, train.width, train.epochs, train.steps)
        })
        .collect();
    let default = Pipeline::default().train;
    assert_eq!(shown, [(4, 8, 1, default.steps), (7, 8, default.epochs, 2)]);
}

#[test]
fn a_file_without_variants_is_a_sweep_of_one() {
    let Sweep { comparison, cases } = read("[train]\nk = 3\nseed = 2", &[], Effort::Full).unwrap();
    assert_eq!(comparison, None);
    let [Case { variant, seed: 2, pipeline }] = &cases[..] else { panic!("{cases:?}") };
    assert_eq!((variant.as_str(), pipeline.train.k), ("", 3.into()));
    assert_eq!(cases[0].folder(), PathBuf::new());
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let message = |text: &str| read(text, &[], Effort::Full).unwrap_err().to_string();
    let said = |text: &str, parts: &[&str]| {
        let message = message(text);
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    };
    said("[[variant]]\nname = \"a\"\ntrain.widht = 3", &["variant \"a\"", "`train.width`"]);
    said("[[variant]]\nname = \"a\"\ntrain.width = 0", &["variant \"a\"", "at least 1"]);
    said("[[variant]]\ntrain.width = 3", &["needs a name"]);
    said("[[variant]]\nname = \"a b\"\n[[variant]]\nname = \"a-b\"", &["other names"]);
    said("[[variant]]\nname = \"a\"\nprinted.x = 1.0", &["sweep.columns has no \"x\""]);
    said("[sweep]\ntitle = \"x\"", &["no [[variant]]"]);
    said("[sweep]\ntitel = \"x\"\n[[variant]]\nname = \"a\"", &["[sweep]", "titel"]);
    said("[train]\nseed = 3\n[[variant]]\nname = \"a\"", &["write sweep.seeds = [3]"]);
    said("variant = 3", &["[[variant]]"]);
    said("[quick]\ntrain.stepps = 3", &["[quick]", "`train.steps`"]);
    let column = "[sweep]\ncolumns = [{ name = \"e\", what = \"mse\", k = 0 }]";
    said(&format!("{column}\n[[variant]]\nname = \"a\""), &["k counts from 1"]);
}
