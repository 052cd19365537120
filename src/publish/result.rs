//! What was found of one mesh and how it was checked: `spectrum.json`.
//!
//! Nothing here depends on when, how fast or from which cache the work was done, so equal work gives equal bytes.

use serde::{Deserialize, Serialize};

use super::json::{document, null_is_nan};
use crate::mesh::{Area, Ingested, MeshHash, Repairs};
use crate::operators::Quality;
use crate::spectrum::certificate::{self, PairCertificate};
use crate::spectrum::closed_form::Deviation;
use crate::spectrum::mpgd;

/// The format of `spectrum.json`. A document of another format does not read as [`Spectrum`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum SpectrumSchema {
    /// The one that [`Spectrum`] describes.
    #[default]
    #[serde(rename = "chladni-spectrum-1")]
    V1,
}

/// The document `spectrum.json`: the lowest eigenpairs of one mesh, with their checks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Spectrum {
    /// The format.
    pub schema: SpectrumSchema,
    /// Whether every check came out within the tolerances.
    pub status: Verdict,
    /// The mesh.
    pub mesh: MeshSummary,
    /// One entry a pair, by ascending k.
    pub eigenpairs: Vec<Eigenpair>,
    /// max |ΦᵀBΦ − I|.
    #[serde(deserialize_with = "null_is_nan")]
    pub orthonormality: f64,
    /// Whether an eigenvalue was missed or repeated; null where nothing was counted.
    pub completeness: Option<Completeness>,
    /// How good the triangles are that the operators were assembled from; null where none were.
    pub quality: Option<TriangleQuality>,
    /// What was mended between the file and the mesh.
    pub repairs: RepairCounts,
    /// What made these numbers.
    pub provenance: Provenance,
}

impl Spectrum {
    /// The bytes of `spectrum.json`.
    pub fn to_json(&self) -> Vec<u8> {
        document(self)
    }
}

/// The outcome of a check against the tolerances of the pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Within all tolerances.
    Verified,
    /// Outside some tolerance, or not measurable.
    Unverified,
}

impl Verdict {
    /// The word used in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Verified => "verified",
            Self::Unverified => "unverified",
        }
    }
}

/// A mesh in numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshSummary {
    /// The content hash.
    pub hash: MeshHash,
    /// V, the number of vertices.
    pub vertices: usize,
    /// F, the number of triangles.
    pub faces: usize,
    /// Pieces that share no vertex.
    pub components: usize,
    /// Closed curves of edges with one triangle.
    pub boundary_loops: usize,
    /// χ = V − E + F.
    pub euler: i64,
    /// Surface area in squared input units.
    #[serde(deserialize_with = "null_is_nan")]
    pub area: f64,
}

impl From<&Ingested> for MeshSummary {
    fn from(ingested: &Ingested) -> Self {
        Self {
            hash: ingested.mesh.hash(),
            vertices: ingested.mesh.n(),
            faces: ingested.mesh.faces().len(),
            components: ingested.topology.components,
            boundary_loops: ingested.topology.boundary_loops,
            euler: ingested.topology.euler_characteristic,
            area: ingested.mesh.area().0,
        }
    }
}

/// One eigenpair (λ, φ) and what was measured of it. See [`PairCertificate`] for the measures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Eigenpair {
    /// Its place, from 1.
    pub k: usize,
    /// θ, the Rayleigh quotient of φ, in 1/(input unit)².
    #[serde(deserialize_with = "null_is_nan")]
    pub lambda: f64,
    /// λ of the refined pair; only there when the pair was refined. `lambda` and the angles are those before, all other
    /// measures and the verdict those of the refined pair.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda_refined: Option<f64>,
    /// λ times the surface area, which has no unit; null for the graph Laplacian.
    #[serde(deserialize_with = "null_is_nan")]
    pub lambda_area: f64,
    /// Where φ comes from.
    pub source: Source,
    /// The cluster of the reference spectrum that it belongs to, from 0.
    pub cluster: usize,
    /// ‖Lφ − θBφ‖ in the B⁻¹ norm.
    #[serde(deserialize_with = "null_is_nan")]
    pub residual: f64,
    /// The energy residual ρ.
    #[serde(deserialize_with = "null_is_nan")]
    pub rho: f64,
    /// M-PGD's eigenvalue; null when M-PGD did not get there.
    #[serde(deserialize_with = "null_is_nan")]
    pub lambda_mpgd: f64,
    /// The reference solver's eigenvalue.
    #[serde(deserialize_with = "null_is_nan")]
    pub lambda_fem: f64,
    /// Largest principal angle to M-PGD's cluster, radians.
    #[serde(deserialize_with = "null_is_nan")]
    pub angle_mpgd: f64,
    /// Largest principal angle to the reference cluster, radians.
    #[serde(deserialize_with = "null_is_nan")]
    pub angle_fem: f64,
    /// How M-PGD went; null for pairs that were given to it and pairs it did not get to.
    pub mpgd: Option<MpgdRun>,
    /// What a formula says of it (`verify.closed_form`); only there where one is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub closed_form: Option<AgainstFormula>,
    /// Whether the measures are within the tolerances.
    pub verdict: Verdict,
}

/// An eigenpair held against a formula. See [`Deviation`] for the measures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AgainstFormula {
    /// The exact eigenvalue.
    #[serde(deserialize_with = "null_is_nan")]
    pub lambda: f64,
    /// Of this pair, before any refinement.
    #[serde(flatten)]
    pub own: FromFormula,
    /// Of the reference solver's.
    pub fem: Option<FromFormula>,
    /// Of M-PGD's; null where it was not asked or did not get there.
    pub mpgd: Option<FromFormula>,
}

/// How far a function is from the closest one of the exact eigenspace.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FromFormula {
    /// The angle between them, radians.
    #[serde(deserialize_with = "null_is_nan")]
    pub angle: f64,
    /// (31), both of unit B-norm.
    #[serde(deserialize_with = "null_is_nan")]
    pub mse: f64,
    /// (31), both of unit 2-norm.
    #[serde(deserialize_with = "null_is_nan")]
    pub mse_euclidean: f64,
}

impl From<&Deviation> for FromFormula {
    fn from(&Deviation { angle, mse, mse_euclidean, .. }: &Deviation) -> Self {
        Self { angle, mse, mse_euclidean }
    }
}

impl Eigenpair {
    /// Pair `k` (from 1) of a mesh of this area, with its measures.
    pub fn new(
        k: usize,
        source: Source,
        verdict: Verdict,
        measured: &PairCertificate,
        area: Area,
    ) -> Self {
        Self {
            k,
            lambda: measured.lambda,
            lambda_refined: None,
            lambda_area: measured.lambda * area.0,
            source,
            cluster: measured.cluster,
            residual: measured.residual,
            rho: measured.rho,
            lambda_mpgd: measured.lambda_mpgd,
            lambda_fem: measured.lambda_fem,
            angle_mpgd: measured.angle_mpgd,
            angle_fem: measured.angle_fem,
            mpgd: measured.mpgd.map(MpgdRun::from),
            closed_form: None,
            verdict,
        }
    }
}

/// Where an eigenfunction comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The normalised indicator of a component, known in advance.
    Constant,
    /// A block trained on the family of this mesh.
    Trained,
    /// A model that was given, or that of the mesh's previous version.
    Predicted,
    /// The trunks of the mesh's previous version, with heads solved on this mesh, or trained on.
    Finetuned,
    /// A solver, from a learned eigenfunction.
    Refined,
    /// The reference solver.
    Fem,
    /// M-PGD.
    Mpgd,
}

impl Source {
    /// The word used in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Trained => "trained",
            Self::Predicted => "predicted",
            Self::Finetuned => "finetuned",
            Self::Refined => "refined",
            Self::Fem => "fem",
            Self::Mpgd => "mpgd",
        }
    }
}

/// How M-PGD went for one pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MpgdRun {
    /// Steps taken.
    pub iterations: usize,
    /// Which condition ended it.
    pub stopped_by: mpgd::StoppedBy,
}

impl From<mpgd::Run> for MpgdRun {
    fn from(run: mpgd::Run) -> Self {
        Self { iterations: run.iterations, stopped_by: run.stopped_by }
    }
}

/// Whether an eigenvalue was missed or repeated. See [`certificate::Completeness`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Completeness {
    /// The shift, in 1/(input unit)².
    #[serde(deserialize_with = "null_is_nan")]
    pub sigma: f64,
    /// The exact number of eigenvalues below σ; null when rounding could have changed it.
    pub count: Option<usize>,
    /// The number of Ritz values of the set below σ.
    pub found: usize,
    /// Nothing is missing.
    pub complete: bool,
    /// K ends inside a cluster, whose further members were not asked for.
    pub cut_cluster: bool,
}

impl From<certificate::Completeness> for Completeness {
    fn from(counted: certificate::Completeness) -> Self {
        let certificate::Completeness { sigma, count, found, complete, cut_cluster } = counted;
        Self { sigma, count, found, complete, cut_cluster }
    }
}

/// How good the triangles are. See [`Quality`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TriangleQuality {
    /// The smallest angle, degrees.
    #[serde(deserialize_with = "null_is_nan")]
    pub min_angle_degrees: f64,
    /// Pairs of vertices whose cotangent weight is negative.
    pub negative_weights: usize,
    /// Edges that are not Delaunay.
    pub non_delaunay_edges: usize,
    /// What was added to every edge length; null without `operators.robust`.
    pub mollification: Option<f64>,
    /// How many edges were flipped; null without `operators.robust`.
    pub flips: Option<usize>,
}

impl From<Quality> for TriangleQuality {
    fn from(quality: Quality) -> Self {
        let Quality { min_angle_degrees, negative_weights, non_delaunay_edges, remedies } = quality;
        Self {
            min_angle_degrees,
            negative_weights,
            non_delaunay_edges,
            mollification: remedies.map(|done| done.mollification),
            flips: remedies.map(|done| done.flips),
        }
    }
}

/// How often each repair was made.
pub type RepairCounts = Repairs<usize>;

/// What made the numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// The version of this crate.
    pub chladni: String,
    /// The parameters of the pipeline that can change a number.
    pub parameters: serde_json::Value,
    /// The previous version that these pairs come from; only there when they do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grown_from: Option<Ancestor>,
}

/// A previous version of a mesh, and what was taken from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ancestor {
    /// The mesh that its blocks were trained for, or whose pairs the solver began with.
    pub mesh: MeshHash,
    /// What was taken from it.
    pub how: Inheritance,
}

/// What was taken from a previous version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Inheritance {
    /// Its blocks, which predict as they are.
    AsTheyAre,
    /// Its trunks, with heads solved on the new mesh.
    Heads,
    /// Its weights, from which training went on.
    FineTuned,
    /// Its eigenfunctions, with which the solver began.
    WarmStart,
}

impl Provenance {
    /// These parameters and the version that is running.
    pub fn new(parameters: serde_json::Value) -> Self {
        Self { chladni: env!("CARGO_PKG_VERSION").to_owned(), parameters, grown_from: None }
    }
}

impl Inheritance {
    /// What happened.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::AsTheyAre => "predicted with the blocks of a previous version",
            Self::Heads => "trunks of a previous version, with heads solved on this mesh",
            Self::FineTuned => "trained on from the blocks of a previous version",
            Self::WarmStart => "solved, beginning with the eigenfunctions of a previous version",
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
