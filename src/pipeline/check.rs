//! Which values can work, alone and together: what a pipeline is held against before anything is computed.

use toml::Table;

use super::{
    Count, Method, MpgdDirection, MpgdStep, Pipeline, PipelineError, RecipeName, Refine, Train,
    Verify,
};
use crate::descriptors::Descriptor;
use crate::ggnn::network::Layer;
use crate::ggnn::recipe::Trunks;
use crate::operators::{Laplacian, OperatorOptions};
use crate::remesh::{FamilyRecipe, Operation, Resolution};

/// Options that only one recipe reads.
const RITZ_ONLY: [&str; 10] = [
    "train.trunk",
    "train.steps",
    "train.ridge",
    "train.spare",
    "train.head_subdivisions",
    "train.shards",
    "train.held_out",
    "train.tune",
    "train.fine_tune",
    "train.boundary_penalty",
];

/// Options that only a shared trunk reads.
const SHARED_ONLY: [&str; 1] = ["train.spare"];
const PAPER_ONLY: [&str; 9] = [
    "train.epochs",
    "train.milestones",
    "train.decay",
    "train.boundary_weight",
    "train.residual_weight",
    "train.orthogonality_weight",
    "train.residual_start",
    "train.residual_warmup",
    "train.residual_rows",
];

/// More would make meshes of hundreds of times the size.
const MOST_SUBDIVISIONS: usize = 3;

/// Refuses the first of these options that is not finite or of which `holds` is not true.
fn refuse_unless(
    options: &[(&'static str, f64)],
    holds: impl Fn(f64) -> bool,
    rule: &'static str,
) -> Result<(), PipelineError> {
    match options.iter().find(|(_, value)| !(holds(*value) && value.is_finite())) {
        Some(&(key, value)) => Err(PipelineError::Value { key, value: value.to_string(), rule }),
        None => Ok(()),
    }
}

impl Pipeline {
    /// Whether the values can work, alone and together.
    ///
    /// # Errors
    /// [`PipelineError::Value`].
    pub fn check(&self) -> Result<(), PipelineError> {
        self.check_method()?;
        self.check_operators()?;
        self.verify.check_step()?;
        self.train.check_layer()?;
        self.train.check_recipe()?;
        self.check_sizes()?;
        self.check_family()?;
        self.check_held_out()?;
        self.check_publish()?;
        self.check_numbers()
    }

    fn check_sizes(&self) -> Result<(), PipelineError> {
        let (Pipeline { train, family, features, verify, .. }, any) = (self, usize::MAX);
        // Of a share nobody knows yet how many it is.
        let number = if let Count::Number(k) = train.k { k } else { 1 };
        // What is beyond the largest is a slip of the keyboard, and would be found out by running out of memory.
        for (key, value, least, largest) in [
            ("train.k", number, 1, 10_000),
            ("train.width", train.width, 1, 8_192),
            ("train.iterations", train.iterations, 1, 64),
            ("train.steps", train.steps, 1, any),
            ("train.batch", train.batch, 1, any),
            ("train.epochs", train.epochs, 1, any),
            ("train.shards", train.shards, 1, 256),
            ("family.members", family.members, 1, 10_000),
            ("features.landmarks", features.landmarks, 1, 1_024),
            ("verify.mpgd_iterations", verify.mpgd_iterations, 1, any),
            ("train.layers", train.layers, 0, 64),
            ("train.spare", train.spare, 0, 1_024),
            ("train.head_subdivisions", train.head_subdivisions, 0, MOST_SUBDIVISIONS),
            ("train.tune", train.tune, 0, 1_024),
        ] {
            let rule = match value {
                _ if value < least => "must be at least 1",
                _ if value > largest => "is more than can be meant; lower it",
                _ => continue,
            };
            return Err(PipelineError::Value { key, value: value.to_string(), rule });
        }
        match train.k {
            Count::Percent(percent) if !(percent > 0.0 && percent <= 100.0) => {
                let rule = "is a share of the vertices, above 0 and up to 100 %";
                Err(PipelineError::Value { key: "train.k", value: train.k.to_string(), rule })
            }
            _ => Ok(()),
        }
    }

    fn check_numbers(&self) -> Result<(), PipelineError> {
        let Pipeline { train, family, verify, .. } = self;
        let positive = [
            ("train.learning_rate", train.learning_rate),
            ("train.encoder_range", train.encoder_range),
            ("train.decay", train.decay),
            ("train.boundary_penalty", train.boundary_penalty),
            ("verify.lambda_tolerance", verify.lambda_tolerance),
            ("verify.angle_tolerance", verify.angle_tolerance),
            ("verify.orthonormality_tolerance", verify.orthonormality_tolerance),
            ("verify.residual_tolerance", verify.residual_tolerance),
            ("verify.mpgd_tolerance", verify.mpgd_tolerance),
        ];
        refuse_unless(&positive, |value| value > 0.0, "must be a positive number")?;
        let not_negative = [
            ("train.hidden_range", train.hidden_range),
            ("train.ridge", train.ridge),
            ("train.boundary_weight", train.boundary_weight),
            ("train.residual_weight", train.residual_weight),
            ("train.orthogonality_weight", train.orthogonality_weight),
            ("train.residual_start", train.residual_start),
            ("family.jitter", family.jitter),
            ("family.perturbation", family.perturbation),
            ("family.flips", family.flips),
        ];
        refuse_unless(&not_negative, |value| value >= 0.0, "must not be negative")?;
        let share = [("train.fine_tune", train.fine_tune)];
        refuse_unless(&share, |value| (0.0..=1.0).contains(&value), "is a share, from 0 to 1")
    }

    fn check_family(&self) -> Result<(), PipelineError> {
        let FamilyRecipe { operations, vertices, flips, .. } = &self.family;
        let refuse = |key, value: String, rule| Err(PipelineError::Value { key, value, rule });
        let Resolution { fewest, most } = *vertices;
        if fewest < 4 {
            let rule = "a closed surface has at least 4 vertices";
            return refuse("family.vertices", fewest.to_string(), rule);
        }
        if fewest > most {
            let rule = "write the smaller number first";
            return refuse("family.vertices", format!("[{fewest}, {most}]"), rule);
        }
        if operations.is_empty() {
            let rule = "name what makes a variant, such as \"simplify\"; family.members = 1 trains on the mesh alone";
            return refuse("family.operations", "[]".into(), rule);
        }
        let subdivisions = operations.iter().filter(|&&o| o == Operation::Subdivide).count();
        if subdivisions > MOST_SUBDIVISIONS {
            let rule = "each makes four triangles of one; \"subdivide\" at most three times";
            return refuse("family.operations", format!("{subdivisions} × subdivide"), rule);
        }
        if *flips > 1.0 {
            let rule = "is the share of edges that are tried, at most 1";
            return refuse("family.flips", flips.to_string(), rule);
        }
        Ok(())
    }

    /// Whether a family has as many members as are not to be trained on, and one more.
    fn check_held_out(&self) -> Result<(), PipelineError> {
        let (members, Train { held_out, tune, .. }) = (self.family.members, &self.train);
        let refuse = |key, value: usize, rule| {
            Err(PipelineError::Value { key, value: value.to_string(), rule })
        };
        if *held_out >= members {
            let rule = "leaves no variant to train on; raise family.members, or lower it";
            return refuse("train.held_out", *held_out, rule);
        }
        if *tune > 0 && members < 2 {
            let rule = "needs a variant to judge by; raise family.members, or set it to 0";
            return refuse("train.tune", *tune, rule);
        }
        Ok(())
    }

    fn check_publish(&self) -> Result<(), PipelineError> {
        let asked = self.publish.descriptors.contains(&Descriptor::ShapeDna);
        if asked && self.operators.laplacian == Laplacian::Graph {
            return Err(PipelineError::Value {
                key: "publish.descriptors",
                value: format!("{:?}", Descriptor::ShapeDna.name()),
                rule: "multiplies λ by the area, which the graph Laplacian does not see; leave it out",
            });
        }
        Ok(())
    }

    fn check_method(&self) -> Result<(), PipelineError> {
        let Train { method, model, refine, .. } = &self.train;
        let refuse = |key, value: &str, rule| {
            Err(PipelineError::Value { key, value: format!("{value:?}"), rule })
        };
        match method {
            Method::Predict if model.is_empty() => refuse(
                "train.model",
                "",
                "train.method = \"predict\" needs a model: a file, or a name of `chladni model list`",
            ),
            Method::LepDpinn | Method::Fem | Method::Mpgd if !model.is_empty() => refuse(
                "train.model",
                model,
                "is for train.method = \"predict\"; set that, or leave it out",
            ),
            Method::Fem | Method::Mpgd if *refine != Refine::None => refuse(
                "train.refine",
                refine.name(),
                "is for learned eigenfunctions; solved ones are as good as they get",
            ),
            _ => Ok(()),
        }
    }

    fn check_operators(&self) -> Result<(), PipelineError> {
        let OperatorOptions { laplacian, mass, robust: _, boundary: _ } = self.operators;
        if let (Some(mass), Err(_)) = (mass, self.operators.mass_kind()) {
            let rule = "\"degree\" belongs to the graph Laplacian, and the other masses to the others; \"auto\" always fits";
            return Err(PipelineError::Value {
                key: "operators.mass",
                value: mass.name().into(),
                rule,
            });
        }
        if matches!(self.train.method, Method::Fem | Method::Mpgd) {
            return Ok(());
        }
        if laplacian == Laplacian::Graph {
            let rule = "cannot be trained: its spectrum belongs to the sampling of a mesh, which every variant changes; choose \"cotangent\" or \"fem\"";
            return Err(PipelineError::Value {
                key: "operators.laplacian",
                value: laplacian.name().into(),
                rule,
            });
        }
        Ok(())
    }
}

/// Options that mean nothing beside this recipe.
pub(super) fn unread(recipe: RecipeName) -> &'static [&'static str] {
    match recipe {
        RecipeName::Ritz => &PAPER_ONLY,
        RecipeName::Paper => &RITZ_ONLY,
    }
}

impl Train {
    /// Refuses options of the recipe, or of the kind of trunk, that is not chosen: they would change nothing.
    fn check_recipe(&self) -> Result<(), PipelineError> {
        let unread: &[(&[&'static str], &'static str)] = match (self.recipe, self.trunk) {
            (RecipeName::Ritz, Trunks::PerEigenfunction) => &[
                (&PAPER_ONLY, "is for train.recipe = \"paper\"; set that, or leave it out"),
                (&SHARED_ONLY, "is for train.trunk = \"shared\"; set that, or leave it out"),
            ],
            (RecipeName::Ritz, Trunks::Shared) => {
                &[(&PAPER_ONLY, "is for train.recipe = \"paper\"; set that, or leave it out")]
            }
            (RecipeName::Paper, _) => {
                &[(&RITZ_ONLY, "is for train.recipe = \"ritz\"; set that, or leave it out")]
            }
        };
        let [given, defaults] = [self, &Self::default()].map(Table::try_from);
        let (given, defaults) = (given.unwrap_or_default(), defaults.unwrap_or_default());
        for (keys, rule) in unread {
            for key in *keys {
                let name = key.rsplit('.').next().unwrap_or(key);
                if let Some(value) =
                    given.get(name).filter(|value| defaults.get(name) != Some(value))
                {
                    return Err(PipelineError::Value { key, value: value.to_string(), rule });
                }
            }
        }
        Ok(())
    }

    fn check_layer(&self) -> Result<(), PipelineError> {
        if matches!(self.layer, Layer::Sggc | Layer::Pointwise) || self.iterations == 1 {
            return Ok(());
        }
        let value = self.iterations.to_string();
        let rule = "only \"sggc\" and \"pointwise\" layers iterate; set train.iterations = 1 beside train.layer = \"gcn\" or \"gat\"";
        Err(PipelineError::Value { key: "train.iterations", value, rule })
    }
}

impl Verify {
    fn check_step(&self) -> Result<(), PipelineError> {
        let MpgdStep::Fixed(alpha) = self.mpgd_step else { return Ok(()) };
        let refuse = |rule| {
            let value = alpha.to_string();
            Err(PipelineError::Value { key: "verify.mpgd_step", value, rule })
        };
        if !(alpha > 0.0 && alpha.is_finite()) {
            return refuse("must be \"exact\" or a positive number");
        }
        if self.mpgd_direction == MpgdDirection::Preconditioned {
            return refuse(
                "a fixed step goes down the plain gradient; set verify.mpgd_direction = \"gradient\" beside it, or take the \"exact\" step",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::parse;
    use super::*;
    use crate::ggnn::network::Interval;
    use crate::ggnn::ops::activation::Activation;
    use crate::ggnn::recipe::Recipe;
    use crate::pipeline::ExportFormat;

    #[test]
    fn wrong_values_say_which_and_why() {
        assert_eq!(
            parse("", &["train.k=0"]).unwrap_err().to_string(),
            "train.k = 0: must be at least 1"
        );
        assert!(parse("[train]\nk = \"many\"", &[]).unwrap_err().to_string().contains("line 2"));
        assert_eq!(parse("", &["train.k=10%"]).unwrap().train.k, Count::Percent(10.0));
        for share in ["0%", "101%", "nan%"] {
            let message = parse("", &[&format!("train.k={share}")]).unwrap_err().to_string();
            assert!(message.contains("a share of the vertices"), "{message}");
        }
        assert!(parse("", &["train.k"]).unwrap_err().to_string().contains("KEY=VALUE"));
        assert!(parse("", &["verify.angle_tolerance=nan"]).is_err());
    }

    #[test]
    fn layers_and_activations_go_by_name_and_only_sggc_iterates() {
        let options =
            "[train]\nlayer = \"gat\"\nactivation = \"relu\"\ninitial_weights = \"positive\"";
        let recipe = parse(options, &[]).unwrap().train.recipe(3);
        let Recipe::Ritz(recipe) = recipe else { panic!("{recipe:?}") };
        assert_eq!(recipe.shape.layer, Layer::Gat);
        assert_eq!(recipe.shape.activation, Activation::Relu);
        assert_eq!(recipe.ranges.interval, Interval::Positive);
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.layer=gcn", "train.iterations=2"]);
        assert!(refused.starts_with("train.iterations = 2: only \"sggc\" and"), "{refused}");
        assert!(parse("", &["train.iterations=2"]).is_ok());
        let unknown = message(&["train.layer=gin"]);
        assert!(
            ["gin", "sggc", "gcn", "gat"].iter().all(|name| unknown.contains(name)),
            "{unknown}"
        );
    }

    #[test]
    fn a_family_is_a_list_of_operations_and_a_number_of_vertices_or_a_range() {
        let text = "[family]\noperations = [\"subdivide\", \"flip\"]\nvertices = [400, 800]";
        let family = parse(text, &[]).unwrap().family;
        assert_eq!(family.operations, [Operation::Subdivide, Operation::Flip]);
        assert_eq!(family.vertices, Resolution { fewest: 400, most: 800 });
        assert_eq!(parse("", &["family.vertices=2000"]).unwrap(), Pipeline::default());
        let message = |set: &str| parse("", &[set]).unwrap_err().to_string();
        assert!(message("family.vertices=3").starts_with("family.vertices = 3: a closed"));
        assert!(message("family.vertices=[9, 8]").contains("the smaller number first"));
        assert!(message("family.operations=[]").contains("family.members = 1"));
        assert!(message("family.flips=2").contains("at most 1"));
        assert!(message("family.vertices=few").contains("the range [fewest, most]"));
        let four = "family.operations=[\"subdivide\", \"subdivide\", \"subdivide\", \"subdivide\"]";
        assert!(message(four).starts_with("family.operations = 4 × subdivide"));
        let unknown = message("family.operations=[\"smooth\"]");
        assert!(unknown.contains("smooth") && unknown.contains("perturb"), "{unknown}");
    }

    #[test]
    fn a_laplacian_takes_its_own_masses_only_and_the_graph_is_not_trained() {
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let graph = "operators.laplacian=graph";
        assert!(message(&["operators.mass=degree"]).starts_with("operators.mass = degree: "));
        assert!(message(&[graph, "operators.mass=lumped"]).starts_with("operators.mass = lumped"));
        assert!(message(&[graph]).starts_with("operators.laplacian = graph: cannot be trained"));
        assert!(parse("", &["operators.laplacian=fem", "operators.mass=voronoi"]).is_ok());
    }

    #[test]
    fn formats_and_descriptors_are_known_names() {
        let message = |set: &str| parse("", &[set]).unwrap_err().to_string();
        let publish = parse("", &["publish.formats=[\"vtu\", \"mat\"]"]).unwrap().publish;
        assert!(publish.writes(ExportFormat::Npz) && publish.writes(ExportFormat::Mat));
        assert!(!publish.writes(ExportFormat::Ply));
        assert!(message("publish.formats=[\"stl\"]").contains("`vtu`"));
        assert!(message("publish.descriptors=[\"sihks\"]").contains("`shape-dna`"));
        let graph = [
            "train.method=fem",
            "operators.laplacian=graph",
            "publish.descriptors=[\"shape-dna\"]",
        ];
        let refused = parse("", &graph).unwrap_err().to_string();
        assert!(refused.starts_with("publish.descriptors = \"shape-dna\": "), "{refused}");
    }

    #[test]
    fn a_fixed_step_goes_down_the_plain_gradient_only() {
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let gradient = "verify.mpgd_direction=gradient";
        let fixed = parse("[verify]\nmpgd_step = 0.001", &[gradient]).unwrap();
        assert_eq!(fixed.verify.mpgd_step, MpgdStep::Fixed(0.001));
        let exact = parse("[verify]\nmpgd_step = 0.001", &["verify.mpgd_step=exact"]).unwrap();
        assert_eq!(exact.verify.mpgd_step, MpgdStep::Exact);
        let refused = message(&["verify.mpgd_step=0.001"]);
        assert!(refused.starts_with("verify.mpgd_step = 0.001: "), "{refused}");
        assert!(refused.contains("verify.mpgd_direction = \"gradient\""), "{refused}");
        for alpha in ["0", "-1.0", "nan", "inf"] {
            let refused = message(&[&format!("verify.mpgd_step={alpha}"), gradient]);
            assert!(refused.contains("\"exact\" or a positive number"), "{refused}");
        }
        let unknown = parse("[verify]\nmpgd_step = \"exakt\"", &[]).unwrap_err().to_string();
        let expected = "invalid value: string \"exakt\", expected \"exact\" or a positive number";
        assert!(unknown.contains("line 2") && unknown.contains(expected), "{unknown}");
    }
}
