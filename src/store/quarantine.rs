//! Why an entry was dropped: the faults that make one untrustworthy, and the record that is kept of it.
//!
//! The bytes themselves are not kept: they can be computed again, which is the point of a cache. The record tells
//! the user that the disk loses data, and where it began.

use std::fmt;

use super::CacheKey;
use super::chunk::ChunkFault;

/// What is wrong with an entry.
#[derive(Debug)]
pub(super) enum Fault {
    /// The manifest is not one that was written under this key.
    Manifest,
    /// A chunk is missing, cut or changed.
    Chunk(ChunkFault),
    /// Each chunk is sound and together they are not the entry: a mix of two writes.
    Whole,
    /// The bytes are those that were written, and no artifact of their type.
    Undecodable(String),
}

impl Fault {
    /// Tells the user that the entry of `key` goes.
    pub fn warn(&self, key: &CacheKey) {
        tracing::warn!(
            %key,
            reason = %self,
            "a cached result is damaged; it is dropped and computed again"
        );
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Manifest => f.write_str("the manifest does not match its checksum"),
            Self::Chunk(fault) => fault.fmt(f),
            Self::Whole => f.write_str("the bytes do not match the digest of the whole"),
            Self::Undecodable(reason) => f.write_str(reason),
        }
    }
}

/// An entry that was dropped because its bytes could not be trusted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Quarantined {
    /// The key of the entry.
    pub key: CacheKey,
    /// When it was dropped, in seconds since 1970.
    pub at: u64,
    /// What was wrong with it.
    pub reason: String,
}

impl Quarantined {
    /// The record of a quarantine: the time, then the reason.
    pub(super) fn encode(at: u64, reason: &str) -> Vec<u8> {
        [&at.to_le_bytes(), reason.as_bytes()].concat()
    }

    /// Reads the record of `key`; `None` if either is too short.
    pub(super) fn decode(key: &[u8], record: &[u8]) -> Option<Self> {
        let (at, reason) = record.split_first_chunk()?;
        Some(Self {
            key: CacheKey::from_bytes(key.try_into().ok()?),
            at: u64::from_le_bytes(*at),
            reason: String::from_utf8_lossy(reason).into_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_comes_back_and_a_short_one_is_skipped() {
        let reason = Fault::Chunk(ChunkFault::Missing { index: 3 }).to_string();
        let record = Quarantined::encode(1_700_000_000, &reason);
        let expected = Quarantined {
            key: CacheKey::from_bytes([9; 32]),
            at: 1_700_000_000,
            reason: "chunk 3 is missing".to_owned(),
        };
        assert_eq!(Quarantined::decode(&[9; 32], &record), Some(expected));
        assert_eq!(Quarantined::decode(&[9; 31], &record), None);
        assert_eq!(Quarantined::decode(&[9; 32], &record[..7]), None);
    }
}
