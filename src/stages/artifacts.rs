//! What the store keeps of each stage: plain vectors, and how they become the numerics' types again.

use std::sync::Arc;

use rkyv::{Archive, Deserialize, Serialize};

use crate::ggnn::block::{Block, Check, TrainingRecord};
use crate::ggnn::checkpoint::Checkpoint;
use crate::ggnn::network::{Layer, TrunkShape};
use crate::ggnn::ops::activation::Activation;
use crate::ggnn::tune::{Choice, Trial, Tuning};
use crate::mesh::trimesh::InvalidMesh;
use crate::mesh::{Area, TriMesh};
use crate::operators::intrinsic::Remedies;
use crate::operators::{MassKind, Operators, Quality, Sparse};
use crate::remesh::Family;
use crate::spectrum::certificate::{Completeness, PairCertificate, SecondOpinion};
use crate::spectrum::fem::Reference;
use crate::spectrum::mpgd::{Run, StoppedBy};
use crate::spectrum::{Certificate, Dense, Eigenpairs};
use crate::store::Artifact;

macro_rules! artifact {
    ($type:ident, $stage:literal, version $version:literal, schema $schema:literal) => {
        impl Artifact for $type {
            const STAGE: &'static str = $stage;
            const VERSION: u32 = $version;
            const SCHEMA: u32 = $schema;
        }
    };
}

artifact!(FamilyArtifact, "remesh", version 1, schema 1);
artifact!(SurfaceArtifact, "surface", version 1, schema 1);
artifact!(OperatorsArtifact, "assemble", version 1, schema 3);
artifact!(TuneArtifact, "tune", version 1, schema 1);
artifact!(TrunkArtifact, "train", version 3, schema 4);
artifact!(CheckpointArtifact, "checkpoint", version 2, schema 2);
artifact!(PredictionArtifact, "predict", version 1, schema 1);
artifact!(ReferenceArtifact, "reference", version 2, schema 2);
artifact!(SecondOpinionArtifact, "second-opinion", version 1, schema 1);
artifact!(RefinementArtifact, "refine", version 1, schema 1);
artifact!(CertificateArtifact, "certify", version 2, schema 1);

/// A mesh: positions and triangles.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct SurfaceArtifact(MeshParts);

impl From<&TriMesh> for SurfaceArtifact {
    fn from(mesh: &TriMesh) -> Self {
        Self(mesh.into())
    }
}

impl TryFrom<SurfaceArtifact> for TriMesh {
    type Error = InvalidMesh;

    fn try_from(SurfaceArtifact(parts): SurfaceArtifact) -> Result<Self, InvalidMesh> {
        Self::new(parts.vertices, parts.faces)
    }
}

/// The variants of a mesh: positions and triangles.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct FamilyArtifact {
    members: Vec<MeshParts>,
}

/// Positions and triangles.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
struct MeshParts {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
}

impl From<&TriMesh> for MeshParts {
    fn from(mesh: &TriMesh) -> Self {
        Self { vertices: mesh.vertices().to_vec(), faces: mesh.faces().to_vec() }
    }
}

impl From<&Family> for FamilyArtifact {
    fn from(family: &Family) -> Self {
        Self { members: family.members.iter().map(MeshParts::from).collect() }
    }
}

impl TryFrom<FamilyArtifact> for Family {
    type Error = InvalidMesh;

    fn try_from(artifact: FamilyArtifact) -> Result<Self, InvalidMesh> {
        let members =
            artifact.members.into_iter().map(|parts| TriMesh::new(parts.vertices, parts.faces));
        Ok(Self { members: members.collect::<Result<_, _>>()? })
    }
}

/// A sparse matrix in compressed rows.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
struct SparseParts {
    pointers: Vec<u32>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl From<&Sparse> for SparseParts {
    fn from(matrix: &Sparse) -> Self {
        let narrow = |indices: &[usize]| indices.iter().map(|&i| i as u32).collect();
        Self {
            pointers: narrow(&matrix.proper_indptr()),
            columns: narrow(matrix.indices()),
            values: matrix.data().to_vec(),
        }
    }
}

impl From<SparseParts> for Sparse {
    fn from(parts: SparseParts) -> Self {
        let widen = |indices: Vec<u32>| indices.into_iter().map(|i| i as usize).collect();
        let n = parts.pointers.len().saturating_sub(1);
        Self::new((n, n), widen(parts.pointers), widen(parts.columns), parts.values)
    }
}

/// The operators of one mesh.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct OperatorsArtifact {
    adjacency: SparseParts,
    stiffness: SparseParts,
    mass: SparseParts,
    /// Its place in [`MassKind::ALL`].
    mass_kind: u8,
    boundary: Vec<u32>,
    area: f64,
    quality: QualityParts,
}

/// minimum angle, negative weights, edges that are not Delaunay; mollification and flips.
type QualityParts = (f64, u64, u64, Option<(f64, u64)>);

impl From<&Operators> for OperatorsArtifact {
    fn from(operators: &Operators) -> Self {
        Self {
            adjacency: (&operators.adjacency).into(),
            stiffness: (&operators.stiffness).into(),
            mass: (&operators.mass).into(),
            mass_kind: operators.mass_kind as u8,
            boundary: operators.boundary.clone(),
            area: operators.area.0,
            quality: quality_parts(&operators.quality),
        }
    }
}

impl From<OperatorsArtifact> for Operators {
    fn from(artifact: OperatorsArtifact) -> Self {
        Self {
            adjacency: artifact.adjacency.into(),
            stiffness: artifact.stiffness.into(),
            mass: artifact.mass.into(),
            mass_kind: MassKind::ALL[artifact.mass_kind as usize],
            boundary: artifact.boundary,
            area: Area(artifact.area),
            quality: quality_of(artifact.quality),
        }
    }
}

fn quality_parts(quality: &Quality) -> QualityParts {
    let remedies = quality.remedies.map(|done| (done.mollification, done.flips as u64));
    let counts = [quality.negative_weights, quality.non_delaunay_edges].map(|count| count as u64);
    (quality.min_angle_degrees, counts[0], counts[1], remedies)
}

fn quality_of((min_angle_degrees, negative, crossed, remedies): QualityParts) -> Quality {
    let remedies =
        remedies.map(|(mollification, flips)| Remedies { mollification, flips: flips as usize });
    Quality {
        min_angle_degrees,
        negative_weights: negative as usize,
        non_delaunay_edges: crossed as usize,
        remedies,
    }
}

/// A search for a recipe: every candidate with its losses, and which is the best.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct TuneArtifact {
    trials: Vec<TrialParts>,
    best: u32,
}

/// learning rate, encoder range, hidden range, ridge, boundary penalty; batch, spare; the losses of a quarter of the steps
/// and of all.
type TrialParts = ([f64; 5], [u32; 2], f64, Option<f64>);

impl From<&Tuning> for TuneArtifact {
    fn from(tuning: &Tuning) -> Self {
        let parts = |&Trial { choice, quarter, whole }: &Trial| {
            let Choice { learning_rate, encoder_range, hidden_range, ridge, .. } = choice;
            let numbers =
                [learning_rate, encoder_range, hidden_range, ridge, choice.boundary_penalty];
            (numbers, [choice.batch as u32, choice.spare as u32], quarter, whole)
        };
        Self { trials: tuning.trials.iter().map(parts).collect(), best: tuning.best as u32 }
    }
}

impl From<TuneArtifact> for Tuning {
    fn from(TuneArtifact { trials, best }: TuneArtifact) -> Self {
        let trial = |(numbers, [batch, spare], quarter, whole): TrialParts| {
            let [learning_rate, encoder_range, hidden_range, ridge, boundary_penalty] = numbers;
            let (batch, spare) = (batch as usize, spare as usize);
            let choice = Choice {
                learning_rate,
                encoder_range,
                hidden_range,
                ridge,
                batch,
                spare,
                boundary_penalty,
            };
            Trial { choice, quarter, whole }
        };
        Self { trials: trials.into_iter().map(trial).collect(), best: best as usize }
    }
}

/// One trained trunk with the heads on it: the blocks that share it, in the order of their eigenfunctions.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct TrunkArtifact {
    /// inputs, width, layers, iterations; the places in [`Layer::ALL`] and [`Activation::ALL`].
    shape: [u32; 6],
    weights: Vec<Vec<f32>>,
    history: Vec<f64>,
    /// step, loss
    held_out: Vec<(u32, f64)>,
    heads: Vec<HeadParts>,
}

/// w_out; the head's quotient before and after training.
type HeadParts = (Vec<f64>, f64, f64);

impl TrunkArtifact {
    /// Of the blocks of one trunk.
    ///
    /// # Panics
    /// When there is none.
    pub fn of(blocks: &[Block]) -> Self {
        let first = blocks.first().expect("a trunk is trained for a head at least");
        let TrunkShape { inputs, width, layers, iterations, layer, activation } = first.shape;
        let sizes = [inputs, width, layers, iterations, layer as usize, activation as usize];
        let head =
            |Block { head, record, .. }: &Block| (head.clone(), record.untrained, record.trained);
        Self {
            shape: sizes.map(|size| size as u32),
            weights: first.weights.to_vec(),
            history: first.record.history.clone(),
            held_out: numbers_of(&first.record.held_out),
            heads: blocks.iter().map(head).collect(),
        }
    }

    /// The blocks, which share their weights.
    pub fn into_blocks(self) -> Vec<Block> {
        let Self { shape, weights, history, held_out, heads } = self;
        let [inputs, width, layers, iterations, layer, activation] = shape.map(|s| s as usize);
        let (layer, activation) = (Layer::ALL[layer], Activation::ALL[activation]);
        let shape = TrunkShape { inputs, width, layers, iterations, layer, activation };
        let weights = Arc::new(weights);
        let held_out = checks_of(held_out);
        let block = |(head, untrained, trained): HeadParts| Block {
            shape,
            weights: weights.clone(),
            head,
            record: TrainingRecord {
                history: history.clone(),
                untrained,
                trained,
                held_out: held_out.clone(),
            },
        };
        heads.into_iter().map(block).collect()
    }
}

/// A training that is not finished.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct CheckpointArtifact {
    step: u32,
    parameters: Vec<Vec<f32>>,
    moments: [Vec<Vec<f32>>; 2],
    updates: u32,
    history: Vec<f64>,
    under_way: Vec<f64>,
    /// step, loss
    held_out: Vec<(u32, f64)>,
    best: Option<TrunkArtifact>,
}

impl From<Checkpoint> for CheckpointArtifact {
    fn from(checkpoint: Checkpoint) -> Self {
        let Checkpoint { step, parameters, moments, updates, history, under_way, checks, best } =
            checkpoint;
        Self {
            step: step as u32,
            parameters,
            moments,
            updates,
            history,
            under_way,
            held_out: numbers_of(&checks),
            best: (!best.is_empty()).then(|| TrunkArtifact::of(&best)),
        }
    }
}

impl From<CheckpointArtifact> for Checkpoint {
    fn from(artifact: CheckpointArtifact) -> Self {
        let CheckpointArtifact {
            step,
            parameters,
            moments,
            updates,
            history,
            under_way,
            held_out,
            best,
        } = artifact;
        Self {
            step: step as usize,
            parameters,
            moments,
            updates,
            history,
            under_way,
            checks: checks_of(held_out),
            best: best.map(TrunkArtifact::into_blocks).unwrap_or_default(),
        }
    }
}

fn numbers_of(checks: &[Check]) -> Vec<(u32, f64)> {
    checks.iter().map(|check| (check.step as u32, check.loss)).collect()
}

fn checks_of(numbers: Vec<(u32, f64)>) -> Vec<Check> {
    numbers.into_iter().map(|(step, loss)| Check { step: step as usize, loss }).collect()
}

/// n×k vectors, column by column.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
struct Columns {
    n: u32,
    data: Vec<f64>,
}

impl From<&Dense> for Columns {
    fn from(dense: &Dense) -> Self {
        let data = (0..dense.ncols()).flat_map(|j| dense.col(j).iter().copied()).collect();
        Self { n: dense.nrows() as u32, data }
    }
}

impl From<Columns> for Dense {
    fn from(columns: Columns) -> Self {
        let n = columns.n as usize;
        let k = columns.data.len().checked_div(n).unwrap_or(0);
        Self::from_fn(n, k, |i, j| columns.data[j * n + i])
    }
}

/// The predicted eigenfunctions on one mesh.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct PredictionArtifact {
    vectors: Columns,
}

impl From<&Dense> for PredictionArtifact {
    fn from(vectors: &Dense) -> Self {
        Self { vectors: vectors.into() }
    }
}

impl From<PredictionArtifact> for Dense {
    fn from(artifact: PredictionArtifact) -> Self {
        artifact.vectors.into()
    }
}

/// The reference solver's pairs and its count.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct ReferenceArtifact {
    values: Vec<f64>,
    vectors: Columns,
    sigma: f64,
    count: Option<u32>,
}

impl From<&Reference> for ReferenceArtifact {
    fn from(reference: &Reference) -> Self {
        Self {
            values: reference.pairs.values.clone(),
            vectors: (&reference.pairs.vectors).into(),
            sigma: reference.sigma,
            count: reference.count.map(|count| count as u32),
        }
    }
}

impl From<ReferenceArtifact> for Reference {
    fn from(artifact: ReferenceArtifact) -> Self {
        let ReferenceArtifact { values, vectors, sigma, count } = artifact;
        let pairs = Eigenpairs { values, vectors: vectors.into() };
        Self { pairs, sigma, count: count.map(|count| count as usize) }
    }
}

/// Refined pairs, and how many blocks of solves they took.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct RefinementArtifact {
    values: Vec<f64>,
    vectors: Columns,
    blocks: u32,
}

impl From<(&Eigenpairs, usize)> for RefinementArtifact {
    fn from((pairs, blocks): (&Eigenpairs, usize)) -> Self {
        let vectors = (&pairs.vectors).into();
        Self { values: pairs.values.clone(), vectors, blocks: blocks as u32 }
    }
}

impl From<RefinementArtifact> for (Eigenpairs, usize) {
    fn from(artifact: RefinementArtifact) -> Self {
        let RefinementArtifact { values, vectors, blocks } = artifact;
        (Eigenpairs { values, vectors: vectors.into() }, blocks as usize)
    }
}

/// M-PGD's pairs and how it went.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct SecondOpinionArtifact {
    values: Vec<f64>,
    vectors: Columns,
    runs: Vec<RunParts>,
}

/// iterations, last change, residual, what stopped it.
type RunParts = (u64, f64, f64, u8);

/// In the order of their codes.
const STOPPED_BY: [StoppedBy; 6] = [
    StoppedBy::Tolerance,
    StoppedBy::Count,
    StoppedBy::AfterUnconverged,
    StoppedBy::Cancelled,
    StoppedBy::Diverged,
    StoppedBy::Stalled,
];

impl From<&SecondOpinion> for SecondOpinionArtifact {
    fn from(opinion: &SecondOpinion) -> Self {
        Self {
            values: opinion.pairs.values.clone(),
            vectors: (&opinion.pairs.vectors).into(),
            runs: opinion.runs.iter().map(run_parts).collect(),
        }
    }
}

impl From<SecondOpinionArtifact> for SecondOpinion {
    fn from(artifact: SecondOpinionArtifact) -> Self {
        let SecondOpinionArtifact { values, vectors, runs } = artifact;
        let pairs = Eigenpairs { values, vectors: vectors.into() };
        Self { pairs, runs: runs.into_iter().map(run_of).collect() }
    }
}

fn run_parts(run: &Run) -> RunParts {
    let code = STOPPED_BY.iter().position(|&by| by == run.stopped_by).unwrap_or(STOPPED_BY.len());
    (run.iterations as u64, run.change, run.residual, code as u8)
}

fn run_of((iterations, change, residual, code): RunParts) -> Run {
    let stopped_by = STOPPED_BY.get(code as usize).copied().unwrap_or(StoppedBy::Count);
    Run { iterations: iterations as usize, change, residual, stopped_by }
}

/// The measurements of a set of eigenpairs.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct CertificateArtifact {
    orthonormality: f64,
    /// cluster; λ, residual, ρ, λ FEM, λ M-PGD, angle FEM, angle M-PGD; M-PGD's run.
    pairs: Vec<(u32, [f64; 7], Option<RunParts>)>,
    sigma: f64,
    count: Option<u32>,
    found: u32,
    complete: bool,
    cut_cluster: bool,
}

impl From<&Certificate> for CertificateArtifact {
    fn from(certificate: &Certificate) -> Self {
        let pair = |p: &PairCertificate| {
            let numbers = [
                p.lambda,
                p.residual,
                p.rho,
                p.lambda_fem,
                p.lambda_mpgd,
                p.angle_fem,
                p.angle_mpgd,
            ];
            (p.cluster as u32, numbers, p.mpgd.as_ref().map(run_parts))
        };
        let Completeness { sigma, count, found, complete, cut_cluster } = certificate.completeness;
        Self {
            orthonormality: certificate.orthonormality,
            pairs: certificate.pairs.iter().map(pair).collect(),
            sigma,
            count: count.map(|c| c as u32),
            found: found as u32,
            complete,
            cut_cluster,
        }
    }
}

impl From<CertificateArtifact> for Certificate {
    fn from(artifact: CertificateArtifact) -> Self {
        let pair = |(cluster, numbers, run): (u32, [f64; 7], Option<RunParts>)| {
            let [lambda, residual, rho, lambda_fem, lambda_mpgd, angle_fem, angle_mpgd] = numbers;
            PairCertificate {
                lambda,
                cluster: cluster as usize,
                residual,
                rho,
                lambda_fem,
                lambda_mpgd,
                angle_fem,
                angle_mpgd,
                mpgd: run.map(run_of),
            }
        };
        Self {
            orthonormality: artifact.orthonormality,
            pairs: artifact.pairs.into_iter().map(pair).collect(),
            completeness: Completeness {
                sigma: artifact.sigma,
                count: artifact.count.map(|c| c as usize),
                found: artifact.found as usize,
                complete: artifact.complete,
                cut_cluster: artifact.cut_cluster,
            },
        }
    }
}
