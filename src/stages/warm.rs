//! The reference solver on a mesh that has changed: it begins with the eigenfunctions of the previous version.
//!
//! Which pairs it finds, and how exactly, does not depend on where it begins, but their last bits do. So a warm result has a key of its
//! own, made of the parent's too, and a cold one that is in the store goes before it. Kept are, for every path, the content
//! that it had last ([`super::lineage`]), for every content where its pairs are and what they grew from, and its surface, on which
//! functions are carried to another sampling.

use rayon::prelude::*;
use rkyv::{Archive, Deserialize, Serialize};

use super::artifacts::{ReferenceArtifact, SurfaceArtifact};
use super::assemble::Assembled;
use super::context::{Context, Recalled};
use super::lineage::{last_version, note, version_key};
use super::{Failure, reference, stand_in};
use crate::mesh::closest::ClosestPoint;
use crate::mesh::{MeshHash, TriMesh};
use crate::operators::Boundary;
use crate::publish::result::{Ancestor, Inheritance};
use crate::spectrum::factor::Analysis;
use crate::spectrum::fem::{self, Reference};
use crate::spectrum::pencil::column;
use crate::spectrum::{Dense, Problem};
use crate::store::{Artifact, CacheKey, Digest};

/// Where the pairs of one content are.
#[derive(Debug, Clone, PartialEq, Eq, Archive, Serialize, Deserialize)]
pub struct SolvedArtifact {
    mesh: [u8; 32],
    /// The key of its pairs.
    pairs: [u8; 32],
    /// The content that the solver began with; none where it began with nothing.
    parent: Option<[u8; 32]>,
}

impl Artifact for SolvedArtifact {
    const STAGE: &'static str = "solved";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 1;
}

/// What the solver begins with.
struct Previous {
    mesh: [u8; 32],
    surface: TriMesh,
    pairs: Reference,
    digest: Digest,
}

/// The reference solver's pairs of a mesh, and what they grew from, if from anything.
///
/// # Errors
/// As [`reference::fem`].
pub fn fem(
    context: &Context,
    item: usize,
    assembled: &Assembled,
) -> Result<(Recalled<ReferenceArtifact>, Option<Ancestor>), Failure> {
    let previous = previous(context, assembled);
    let (recalled, parent) = match &previous {
        None => (reference::fem(context, item, assembled)?, None),
        Some(previous) => (near(context, item, assembled, previous)?, Some(previous.mesh)),
    };
    record(context, assembled, &recalled.key, parent);
    let ancestor =
        |mesh| Ancestor { mesh: MeshHash::from_bytes(mesh), how: Inheritance::WarmStart };
    Ok((recalled, parent.map(ancestor)))
}

fn near(
    context: &Context,
    item: usize,
    assembled: &Assembled,
    previous: &Previous,
) -> Result<Recalled<ReferenceArtifact>, Failure> {
    let k = assembled.loaded.k;
    let work = reference::fem_work(context, assembled).input("parent", &previous.digest);
    let stand_in = || stand_in::reference(assembled.operators.stiffness.rows(), k);
    context.recall_costly(item, work.seeded(0, "f64"), stand_in, || {
        let problem = assembled.problem(context.pipeline.operators.boundary)?;
        let analysis = Analysis::new(problem.pencil())?;
        let start = carried(previous, &assembled.loaded.ingested.mesh, &problem);
        Ok((&fem::lowest_near(&problem, &analysis, k, &start)?).into())
    })
}

/// The previous version's functions on the free vertices of this one.
fn carried(previous: &Previous, mesh: &TriMesh, problem: &Problem<'_>) -> Dense {
    let functions = &previous.pairs.pairs.vectors;
    if previous.surface.faces() == mesh.faces() && functions.nrows() == problem.pencil().n() {
        return functions.clone();
    }
    let surface = ClosestPoint::on(&previous.surface);
    let points: Vec<_> = mesh.vertices().par_iter().map(|&point| surface.to(point)).collect();
    problem.restrict(&Dense::from_fn(points.len(), functions.ncols(), |i, j| {
        points[i].interpolate(&previous.surface, column(functions, j))
    }))
}

/// What the solver is to begin with, where there is something and nothing better.
fn previous(context: &Context, assembled: &Assembled) -> Option<Previous> {
    let store = context.store.as_ref().filter(|_| context.lineage)?;
    let cold = reference::fem_work(context, assembled).seeded(0, "f64");
    if store.peek::<ReferenceArtifact>(cold.key()).is_some() {
        return None;
    }
    let (pipeline, loaded) = (&context.pipeline, &assembled.loaded);
    let own = version_key::<SolvedArtifact>(pipeline, &loaded.hash);
    let parent = match store.get::<SolvedArtifact>(&own) {
        Some(own) => {
            let parent = MeshHash::from_bytes(own.artifact.parent?);
            store.get::<SolvedArtifact>(&version_key::<SolvedArtifact>(pipeline, &parent))?
        }
        None => store.get::<SolvedArtifact>(&last_version(context, loaded)?)?,
    };
    let SolvedArtifact { mesh, pairs, .. } = parent.artifact;
    let pairs = store.get::<ReferenceArtifact>(&CacheKey::from_bytes(pairs))?;
    let surface = store.get::<SurfaceArtifact>(&surface_key(&mesh))?.artifact;
    let surface = TriMesh::try_from(surface).ok()?;
    // Under Dirichlet conditions the functions live on the free vertices alone, which only the same triangles share.
    let is_same = surface.faces() == loaded.ingested.mesh.faces();
    let fits = is_same || pipeline.operators.boundary == Boundary::Neumann;
    let (digest, pairs) = (pairs.digest, Reference::from(pairs.artifact));
    fits.then_some(Previous { mesh, surface, pairs, digest })
}

fn record(context: &Context, assembled: &Assembled, pairs: &CacheKey, parent: Option<[u8; 32]>) {
    let Some(store) = context.writable() else { return };
    let loaded = &assembled.loaded;
    let (mesh, pairs) = (*loaded.hash.as_bytes(), *pairs.as_bytes());
    let surface = surface_key(&mesh);
    if store.peek::<SurfaceArtifact>(&surface).is_none() {
        store.note(&surface, &SurfaceArtifact::from(&loaded.ingested.mesh));
    }
    note(context, store, loaded, &SolvedArtifact { mesh, pairs, parent });
}

fn surface_key(mesh: &[u8; 32]) -> CacheKey {
    SurfaceArtifact::key().param("mesh", mesh).finish(0, "f64")
}
