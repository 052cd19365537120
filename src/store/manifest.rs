//! What the store knows of an entry without reading its bytes: the manifest record.
//!
//! A manifest is what makes an entry exist: it is written last and removed first. It is an rkyv archive followed
//! by a BLAKE3 over the entry's key and that archive, so that neither a flipped bit nor a record under the wrong
//! key passes for an entry.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rkyv::rancor::Error;
use rkyv::util::AlignedVec;

use super::{CacheKey, Digest};

/// The manifest of one entry. Times are seconds since 1970.
#[derive(Debug, Clone, PartialEq, rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
pub(super) struct Manifest {
    /// Of the whole entry, in bytes.
    pub length: u64,
    /// BLAKE3 of the whole entry.
    pub digest: [u8; 32],
    pub stage: String,
    pub version: u32,
    pub schema: u32,
    /// What it took to compute the entry, in seconds.
    pub cost: f64,
    pub created: u64,
    /// When a process last read or wrote the entry for the first time.
    pub last_use: u64,
}

impl Manifest {
    /// The digest of the whole entry.
    pub fn digest(&self) -> Digest {
        Digest::from_bytes(self.digest)
    }

    /// What it took to compute the entry.
    pub fn cost(&self) -> Duration {
        Duration::try_from_secs_f64(self.cost).unwrap_or_default()
    }

    /// The record of this manifest under `key`.
    pub fn encode(&self, key: &CacheKey) -> Result<AlignedVec, Error> {
        let mut record = rkyv::to_bytes::<Error>(self)?;
        let checksum = checksum(key, &record);
        record.extend_from_slice(checksum.as_bytes());
        Ok(record)
    }

    /// Reads the record of `key`; `None` if it is not one that [`encode`](Self::encode) wrote for that key.
    pub fn decode(key: &CacheKey, record: &[u8]) -> Option<Self> {
        let (body, found) = record.split_last_chunk::<32>()?;
        if checksum(key, body).as_bytes() != found {
            return None;
        }
        let mut aligned = AlignedVec::<16>::with_capacity(body.len());
        aligned.extend_from_slice(body);
        rkyv::from_bytes::<Self, Error>(&aligned).ok()
    }
}

fn checksum(key: &CacheKey, body: &[u8]) -> Digest {
    let mut hasher = blake3::Hasher::new_derive_key("chladni store 1 manifest");
    hasher.update(key.as_bytes());
    hasher.update(body);
    Digest::from_bytes(*hasher.finalize().as_bytes())
}

/// Seconds since 1970; 0 on a clock that is set before.
pub(super) fn unix_now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest() -> Manifest {
        Manifest {
            length: 300 << 10,
            digest: [7; 32],
            stage: "a stage with a long name".into(),
            version: 3,
            schema: 2,
            cost: 12.5,
            created: 1_700_000_000,
            last_use: 1_700_000_100,
        }
    }

    #[test]
    fn every_flipped_bit_cut_and_wrong_key_is_seen() {
        let key = CacheKey::from_bytes([1; 32]);
        let record = manifest().encode(&key).unwrap();
        assert_eq!(Manifest::decode(&key, &record), Some(manifest()));
        assert_eq!(Manifest::decode(&CacheKey::from_bytes([2; 32]), &record), None);
        for bit in 0..8 * record.len() {
            let mut damaged = record.to_vec();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Manifest::decode(&key, &damaged), None, "bit {bit}");
        }
        for length in 0..record.len() {
            assert_eq!(Manifest::decode(&key, &record[..length]), None);
        }
    }

    #[test]
    fn an_impossible_cost_counts_as_none() {
        for cost in [f64::NAN, f64::INFINITY, -1.0] {
            let odd = Manifest { cost, ..manifest() };
            assert_eq!(odd.cost(), Duration::ZERO);
        }
        assert_eq!(manifest().cost(), Duration::from_millis(12_500));
    }
}
