//! The on-disk cache: artifacts of any stage, found again by the key of the work that made them.
//!
//! It stands alone: it knows bytes, keys and types that implement [`Artifact`], and nothing of meshes.
//!
//! # Constraints
//! - A value is never wrong. Each read checks every BLAKE3 digest before anything looks at the bytes; what
//!   does not match is quarantined and reads as absent, so that the caller computes it again.
//! - A cache may be lost, never in the way. A database that does not open is moved aside, not repaired, and
//!   the run goes on with an empty one. Only the lock, a newer format and a directory that the system refuses
//!   are errors.
//! - One process at a time holds a directory; within it, any number of threads share a [`Store`].
//! - A local disk: neither the lock nor the database holds on a network file system.
//! - The database may panic on damaged files, so the program has to be built with unwinding panics.
//!
//! # On disk
//! ```text
//! chladni.lock            the process that holds the directory (flock) and its number
//! chladni.format          "chladni store 2": the version of all that follows
//! chladni.suspect         left by a run that met damage inside the database; the next one sets it aside
//! chladni.entries         how many entries there were when the database was closed; gone while it is open
//! chladni.generation      which database counts: the first one, or a later copy
//! chladni.sled[-N]/       the database, three trees:
//!   manifests             key                  → what the entry is, its length and digest; checksum
//!   chunks                key, index (u32 BE)  → digest; up to 2 KiB of the entry's bytes
//!   quarantined           key                  → when and why an entry was dropped
//! quarantine-<unix time>/ a database that did not open; nothing reads it, delete it at will
//! ```
//! An entry's bytes are an envelope (magic, schema, stage) and the rkyv archive of the artifact.
//!
//! Every record stays small, because the database writes larger ones to files that it does not sync (`chunk` has
//! the numbers). So a chunk carries its own digest: a list of them would make the manifest grow with the entry.
//!
//! # How it recovers
//! - *A crash during a write*: the order is manifest away, chunks, flush, manifest, flush. Without a manifest
//!   there is no entry; chunks left behind are replaced by the next write of that key.
//! - *A damaged entry*: the key is quarantined when a read meets it.
//! - *A log that lost its end*: it opens with fewer entries than it was closed with, and a warning.
//! - *A damaged database*: opening sets it aside. If the damage shows later, inside a read or write, that call
//!   fails, and the next opening sets the database aside.
//! - *A directory that cannot be written*: a copy of it can be opened, which lasts as long as the store.
//! - *A full disk*: what has no room is not kept, with one warning; what is there is found.
//! - *Code of another schema*: a miss; the write that follows replaces the entry.
//! - *A database that takes far more than its entries*: opening copies them to the next generation.
//!
//! # What is where
//! `digest`, `key`: names of content and of work. `artifact`: typed values as bytes. `typed`: put and get.
//! `blob` over `manifest`, `chunk` and `quarantine`: bytes in the database. `open`, `lock`, `format`, `recovery`:
//! from a directory to an open store. `copy`: the same for one that cannot be written. `room`: whether its disk has any.
//! `files`: how its files are replaced and removed. `generation`: one database after the other. `retention`: what leaves a store.
//! `tally`: how many there should be. `interruption`: where a crash may fall, for tests. `stat`: what a store holds. `error`: what the user has to decide.

mod artifact;
mod blob;
mod chunk;
mod copy;
#[cfg(test)]
mod crashes;
mod digest;
mod error;
mod files;
mod format;
mod generation;
mod interruption;
mod key;
mod lock;
mod manifest;
mod open;
mod quarantine;
mod recovery;
mod retention;
mod room;
mod stat;
mod tally;
mod typed;

pub use artifact::{Artifact, DecodeError, decode, digest, encode};
pub use digest::Digest;
pub use error::StoreError;
pub use key::{CacheKey, KeyBuilder};
pub use open::Store;
pub use quarantine::Quarantined;
pub use retention::{Compacted, Damaged, Kind, Mode, Swept, Verified};
pub use stat::{StageStat, StoreStat};
pub use typed::{Cached, Peeked};
