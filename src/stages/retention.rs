//! Which entries of the store are of use: those that this version makes, and what models need.

use super::artifacts::{
    CertificateArtifact, CheckpointArtifact, FamilyArtifact, OperatorsArtifact, PredictionArtifact,
    ReferenceArtifact, RefinementArtifact, SecondOpinionArtifact, SurfaceArtifact, TrunkArtifact,
    TuneArtifact,
};
use super::lineage::{self, PathArtifact, VersionArtifact};
use super::models::{self, ModelArtifact};
use super::trials::TrialArtifact;
use super::warm::SolvedArtifact;
use crate::store::{Kind, Store, StoreError};

/// Every kind of entry that this version makes and can use.
pub fn kinds() -> Vec<Kind> {
    vec![
        Kind::of::<FamilyArtifact>(),
        Kind::of::<OperatorsArtifact>(),
        Kind::of::<TuneArtifact>(),
        Kind::of::<TrunkArtifact>(),
        Kind::of::<CheckpointArtifact>(),
        Kind::of::<TrialArtifact>(),
        Kind::of::<PredictionArtifact>(),
        Kind::of::<ReferenceArtifact>(),
        Kind::of::<SecondOpinionArtifact>(),
        Kind::of::<RefinementArtifact>(),
        Kind::of::<CertificateArtifact>(),
        Kind::of::<ModelArtifact>(),
        Kind::of::<VersionArtifact>(),
        Kind::of::<PathArtifact>(),
        Kind::of::<SolvedArtifact>(),
        Kind::of::<SurfaceArtifact>(),
    ]
}

/// Keeps models, and the trunks that they need, whatever room the cache has: they may be of use where their meshes are not.
/// Those of earlier versions of a mesh go like all else.
///
/// # Errors
/// When the database cannot be read.
pub fn keep_models(store: &Store) -> Result<(), StoreError> {
    let superseded = lineage::superseded(store)?;
    store.pin_only(models::keys(store, |name| !superseded(name))?);
    Ok(())
}
