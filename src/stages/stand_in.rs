//! What a plan takes for results that it does not compute: of the right sizes, so that the stages after them can say what they
//! would do, and nothing else.

use std::sync::Arc;

use super::artifacts::{
    CertificateArtifact, PredictionArtifact, ReferenceArtifact, RefinementArtifact,
    SecondOpinionArtifact, TrunkArtifact, TuneArtifact,
};
use crate::ggnn::Block;
use crate::ggnn::block::TrainingRecord;
use crate::ggnn::network::TrunkShape;
use crate::ggnn::tune::Tuning;
use crate::spectrum::certificate::{Completeness, PairCertificate, SecondOpinion};
use crate::spectrum::fem::Reference;
use crate::spectrum::{Certificate, Dense, Eigenpairs};

/// A search that tried nothing.
pub fn tuning() -> TuneArtifact {
    (&Tuning { trials: Vec::new(), best: 0 }).into()
}

/// A trunk without weights, with so many heads.
pub fn trunk(shape: TrunkShape, heads: usize) -> TrunkArtifact {
    let (weights, record) = (Arc::default(), TrainingRecord::default());
    TrunkArtifact::of(&vec![Block { shape, weights, head: Vec::new(), record }; heads])
}

/// `k` functions on `n` vertices.
pub fn functions(n: usize, k: usize) -> PredictionArtifact {
    (&Dense::zeros(n, k)).into()
}

/// `k` pairs on `n` free vertices.
pub fn reference(n: usize, k: usize) -> ReferenceArtifact {
    (&Reference { pairs: pairs(n, k), sigma: 1.0, count: Some(k) }).into()
}

/// As many pairs.
pub fn second_opinion(n: usize, k: usize) -> SecondOpinionArtifact {
    (&SecondOpinion { pairs: pairs(n, k), runs: Vec::new() }).into()
}

/// As many pairs.
pub fn refinement(n: usize, k: usize) -> RefinementArtifact {
    (&pairs(n, k), 0).into()
}

/// A certificate of `k` pairs, none of which was measured.
pub fn certificate(k: usize) -> CertificateArtifact {
    let completeness =
        Completeness { sigma: 1.0, count: None, found: k, complete: false, cut_cluster: false };
    let pairs = vec![PairCertificate::unmeasured(1.0, 0); k];
    (&Certificate { pairs, orthonormality: f64::NAN, completeness }).into()
}

fn pairs(n: usize, k: usize) -> Eigenpairs {
    Eigenpairs { values: vec![1.0; k], vectors: Dense::zeros(n, k) }
}
