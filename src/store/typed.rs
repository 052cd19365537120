//! Putting results into a store and getting them back, by type.
//!
//! A get answers with a result that is certainly the one that was put, or with nothing; nothing means: compute it.
//! The order of its checks: manifest (checksum, stage, schema), each chunk, the whole, the envelope, the archive.

use std::fmt::Display;
use std::time::Duration;

use super::artifact::{Artifact, DecodeError, decode, encode};
use super::blob::{OnDisk, Origin};
use super::manifest::Manifest;
use super::{CacheKey, Digest, Store, StoreError};

/// A result from the store.
#[derive(Debug, Clone, PartialEq)]
pub struct Cached<A> {
    /// The result.
    pub artifact: A,
    /// Of its encoding: what the keys of later stages take as their input.
    pub digest: Digest,
    /// What it took to compute it, that is, what the store saved.
    pub cost: Duration,
}

/// What the store says of a result without reading it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peeked {
    /// Of its encoding: what the keys of later stages take as their input.
    pub digest: Digest,
    /// What it took to compute it.
    pub cost: Duration,
}

impl Store {
    /// Stores the result of the work that `key` names, and that took `cost`, in place of any that is there. It is
    /// on disk when this returns. The digest is that of the encoded artifact.
    ///
    /// # Errors
    /// When the artifact cannot be encoded, or the database not written. The store can still be used.
    pub fn put<A: Artifact>(
        &self,
        key: &CacheKey,
        artifact: &A,
        cost: Duration,
    ) -> Result<Digest, StoreError> {
        self.put_encoded::<A>(key, &encode(artifact)?, cost, OnDisk::Now)
    }

    /// As [`put`](Self::put), but a cache that cannot be written costs no more than a warning, the first time.
    ///
    /// # Errors
    /// When the artifact cannot be encoded.
    pub fn keep<A: Artifact>(
        &self,
        key: &CacheKey,
        artifact: &A,
        cost: Duration,
    ) -> Result<Digest, StoreError> {
        let bytes = encode(artifact)?;
        Ok(self.put_encoded::<A>(key, &bytes, cost, OnDisk::Now).unwrap_or_else(|error| {
            self.complain(A::STAGE, &error);
            Digest::of(&bytes)
        }))
    }

    /// Stores what may help later and is no loss if it is not there, unless it is there already. It is on disk within a second;
    /// that it cannot be written costs a warning, the first time.
    pub fn note<A: Artifact + PartialEq>(&self, key: &CacheKey, artifact: &A) {
        if self.get::<A>(key).is_some_and(|there| there.artifact == *artifact) {
            return;
        }
        let noted = encode(artifact)
            .and_then(|bytes| self.put_encoded::<A>(key, &bytes, Duration::ZERO, OnDisk::Soon));
        if let Err(error) = noted {
            self.complain(A::STAGE, &error);
        }
    }

    /// Warns that a result of `stage` is not kept. On a full disk that is so for all that follow: only the first time is a
    /// warning.
    pub fn complain(&self, stage: &str, error: &dyn Display) {
        if self.blobs().complains() {
            tracing::warn!(
                stage,
                "the result is not cached and will be computed again next time, as others may be: {error}"
            );
        } else {
            tracing::debug!(stage, "the result is not cached: {error}");
        }
    }

    fn put_encoded<A: Artifact>(
        &self,
        key: &CacheKey,
        bytes: &[u8],
        cost: Duration,
        on_disk: OnDisk,
    ) -> Result<Digest, StoreError> {
        let origin = Origin { stage: A::STAGE, version: A::VERSION, schema: A::SCHEMA, cost };
        let digest = self.blobs().write(key, origin, bytes, on_disk)?;
        if let Err(error) = self.make_room() {
            tracing::warn!("the cache is over its limit: {error}");
        }
        Ok(digest)
    }

    /// The result stored under `key`, or `None`: there is none, it is of another stage or schema, or it was damaged
    /// (then it is quarantined, with a warning).
    pub fn get<A: Artifact>(&self, key: &CacheKey) -> Option<Cached<A>> {
        let (manifest, bytes) = self.blobs().read(key, is_of::<A>)?;
        match decode::<A>(&bytes) {
            Ok(artifact) => {
                Some(Cached { artifact, digest: manifest.digest(), cost: manifest.cost() })
            }
            Err(DecodeError::Foreign { .. }) => None,
            Err(error @ DecodeError::Invalid { .. }) => {
                self.blobs().quarantine_undecodable(key, manifest.digest(), error.to_string());
                None
            }
        }
    }

    /// Removes what is stored under `key`, if anything is.
    ///
    /// # Errors
    /// When the database cannot be written.
    pub fn remove(&self, key: &CacheKey) -> Result<(), StoreError> {
        self.blobs().remove([key])
    }

    /// Whether `key` has a result of this type, with its digest, without reading it: for planning what would be
    /// computed. A later [`get`](Self::get) may still find the result damaged.
    pub fn peek<A: Artifact>(&self, key: &CacheKey) -> Option<Peeked> {
        let manifest = self.blobs().manifest(key).filter(is_of::<A>)?;
        Some(Peeked { digest: manifest.digest(), cost: manifest.cost() })
    }

    /// The keys of all results of this type, in no order that means anything.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub fn keys_of<A: Artifact>(&self) -> Result<Vec<CacheKey>, StoreError> {
        let entries = self.blobs().manifests()?.into_iter();
        Ok(entries.filter(|(_, manifest)| is_of::<A>(manifest)).map(|(key, _)| key).collect())
    }
}

fn is_of<A: Artifact>(manifest: &Manifest) -> bool {
    manifest.stage == A::STAGE && manifest.schema == A::SCHEMA
}
