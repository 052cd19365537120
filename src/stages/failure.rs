//! Why a mesh could not be processed: one line in the report, and the others go on.

use crate::descriptors::TooFew;
use crate::flow::Panicked;
use crate::ggnn::model::Unfit;
use crate::ggnn::train::TrainError;
use crate::mesh::MeshError;
use crate::operators::OperatorError;
use crate::publish::PublishError;
use crate::remesh::FamilyError;
use crate::spectrum::SpectrumError;
use crate::spectrum::closed_form::NotOnSurface;
use crate::store::StoreError;

/// What ended the work on one mesh.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The file is no mesh, or not one that we can use.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// More eigenpairs than the mesh can have.
    #[error(
        "the mesh has {n} vertices, too few for {k} eigenpairs; ask for fewer (train.k, or -k)"
    )]
    TooSmall { n: usize, k: usize },
    /// More eigenpairs than a member of the family can have.
    #[error(
        "a variant of the mesh has {n} free vertices, too few for train.k = {k} eigenpairs; raise family.vertices"
    )]
    CoarseFamily { n: usize, k: usize },
    /// The mesh, or a variant of it, has no operators.
    #[error(transparent)]
    Operators(#[from] OperatorError),
    /// No family could be made of it.
    #[error(transparent)]
    Family(#[from] FamilyError),
    /// A factorisation or a solver failed.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// The mesh is not the surface that it is to be measured against.
    #[error(transparent)]
    NotOnSurface(#[from] NotOnSurface),
    /// Training failed.
    #[error("training {functions}: {source}")]
    Train { functions: String, source: TrainError },
    /// More heads than features.
    #[error(
        "a trunk of train.width = {width} features cannot carry the heads of {heads} eigenfunctions; raise train.width, \
         lower train.k, or set train.trunk = \"per-eigenfunction\""
    )]
    NarrowTrunk { heads: usize, width: usize },
    /// The model cannot predict this mesh.
    #[error(transparent)]
    Unfit(#[from] Unfit),
    /// A forward pass gave no function.
    #[error(
        "the model predicts no φ{k} here: its values are no numbers, or it is a combination of the earlier ones; \
         the mesh is not the shape that the model was trained for"
    )]
    NotPredicted { k: usize },
    /// Rayleigh–Ritz found fewer directions than functions.
    #[error(
        "the predicted eigenfunctions are linearly dependent, so they cannot be refined; \
         the mesh is not the shape that the model was trained for"
    )]
    Dependent,
    /// A run was to predict and has nothing to do it with.
    #[error("train.method = \"predict\" needs a model; name one with train.model")]
    NoModel,
    /// Too few eigenpairs for a descriptor.
    #[error(transparent)]
    Descriptors(#[from] TooFew),
    /// The results could not be written.
    #[error(transparent)]
    Publish(#[from] PublishError),
    /// The run was interrupted; what was finished is kept.
    #[error("interrupted; run again to go on from what is finished")]
    Interrupted,
    /// The mesh has changed, or is gone, since the work on it began.
    #[error("there is a newer version of it")]
    Superseded,
    /// It took too long.
    #[error(
        "not done within --time-limit = {limit} s; what is finished is kept, so that more time goes on from it; or make it \
         cheaper (family.vertices, train.steps, train.k)"
    )]
    OutOfTime { limit: f64 },
    /// The run ended before this mesh was begun, because another failed.
    #[error("not started, since an earlier mesh failed (--fail-fast)")]
    NotStarted,
    /// Some area is zero, infinite or not a number in double precision.
    #[error("areas of {area:e} are beyond double precision; scale the mesh to sensible units")]
    Area { area: f64 },
    /// A result that cannot be encoded.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A defect of this program.
    #[error(transparent)]
    Internal(#[from] Panicked),
}

impl Failure {
    /// Whether the file has no object of the name that was asked for.
    pub fn is_no_object(&self) -> bool {
        matches!(self, Self::Mesh(error) if error.is_no_object())
    }

    /// Whether another try may succeed: the system refused something, or this program failed. What a mesh is stays so.
    pub fn is_of_the_moment(&self) -> bool {
        match self {
            Self::Mesh(error) => error.is_unreadable(),
            Self::Publish(error) => error.is_of_the_moment(),
            Self::Store(_) | Self::Internal(_) => true,
            _ => false,
        }
    }

    /// Whether nothing more is to be tried: not because something failed, but because nobody waits for it.
    pub fn ends_the_work(&self) -> bool {
        matches!(self, Self::Interrupted | Self::Superseded | Self::OutOfTime { .. })
    }

    /// Whether this program is to blame, not its input.
    pub fn is_internal(&self) -> bool {
        matches!(self, Self::Internal(_) | Self::Store(_))
    }
}
