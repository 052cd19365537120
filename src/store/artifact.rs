//! How a typed result becomes bytes and comes back: the [`Artifact`] trait and its envelope.
//!
//! ```text
//! 0   "chladni\x01"                magic
//! 8   schema                       u32, little-endian
//! 12  length of the stage name     u32, little-endian
//! 16  stage name, zeros to a multiple of 16
//! ..  rkyv archive of the artifact, its root at the end
//! ```
//! rkyv has no schema evolution: bytes of another type may well pass its checks. So the envelope comes first, and
//! only bytes of the right stage and schema reach it; then every access is a checked one. The archive starts at a
//! multiple of 16 and lies in memory aligned to 16, as it has to.

use rkyv::api::high::{HighDeserializer, HighSerializer, HighValidator, to_bytes_in};
use rkyv::bytecheck::CheckBytes;
use rkyv::rancor::Error;
use rkyv::ser::allocator::ArenaHandle;
use rkyv::util::AlignedVec;
use rkyv::{Archive, Deserialize, Serialize};

use super::{Digest, KeyBuilder, StoreError};

/// The result of one stage, in a form that can be stored.
///
/// Equal values must encode to equal bytes, or early cutoff never cuts: hold `Vec` and `BTreeMap`, not
/// `HashMap`. An archive holds up to 2 GiB.
///
/// ```
/// use chladni::store::{self, Artifact};
///
/// #[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
/// struct Spectrum {
///     eigenvalues: Vec<f64>,
/// }
///
/// impl Artifact for Spectrum {
///     const STAGE: &'static str = "fem";
///     const VERSION: u32 = 1;
///     const SCHEMA: u32 = 1;
/// }
///
/// let spectrum = Spectrum { eigenvalues: vec![0.0, 2.0] };
/// let bytes = store::encode(&spectrum)?;
/// assert_eq!(store::digest(&spectrum)?, store::Digest::of(&bytes));
/// assert_eq!(store::decode::<Spectrum>(&bytes)?.eigenvalues, [0.0, 2.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Artifact:
    Archive<
        Archived: for<'a> CheckBytes<HighValidator<'a, Error>>
                      + Deserialize<Self, HighDeserializer<Error>>,
    > + for<'a> Serialize<HighSerializer<AlignedVec, ArenaHandle<'a>, Error>>
    + Sized
{
    /// The name of the stage that makes it. One stage has one type of result, and a type one stage.
    const STAGE: &'static str;

    /// The version of the stage's code: raise it when the same inputs give other numbers.
    const VERSION: u32;

    /// The version of the type: raise it when a field changes. Entries of another schema are not found.
    const SCHEMA: u32;

    /// Starts the key of this stage.
    fn key() -> KeyBuilder {
        KeyBuilder::new(Self::STAGE, Self::VERSION)
    }
}

/// Why bytes are not an artifact of the wanted type.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The envelope is of another stage or schema, or there is none.
    #[error("not an artifact of stage {stage}, schema {schema}: compute it again")]
    Foreign { stage: &'static str, schema: u32 },
    /// The envelope fits and the archive does not: damaged, or the type changed and its schema did not.
    #[error(
        "not a valid archive of stage {stage}, schema {schema} ({source}): compute it again; if the bytes are \
         undamaged, the type has changed without a new SCHEMA"
    )]
    Invalid { stage: &'static str, schema: u32, source: Error },
}

const MAGIC: [u8; 8] = *b"chladni\x01";
const ALIGNMENT: usize = 16;

/// The artifact as bytes, envelope included. Equal artifacts give equal bytes.
///
/// # Errors
/// [`StoreError::Encode`] when rkyv refuses the value: an archive of more than 2 GiB.
pub fn encode<A: Artifact>(artifact: &A) -> Result<AlignedVec, StoreError> {
    let mut bytes = AlignedVec::<ALIGNMENT>::new();
    bytes.extend_from_slice(&envelope::<A>());
    to_bytes_in(artifact, bytes).map_err(|source| StoreError::Encode { stage: A::STAGE, source })
}

/// The digest of an artifact's encoding, without storing it: what [`Store::put`](super::Store::put) would return.
///
/// # Errors
/// As for [`encode`].
pub fn digest<A: Artifact>(artifact: &A) -> Result<Digest, StoreError> {
    Ok(Digest::of(&encode(artifact)?))
}

/// Reads an artifact from what [`encode`] wrote. Any bytes are safe to pass.
///
/// # Errors
/// Either case of [`DecodeError`].
pub fn decode<A: Artifact>(bytes: &AlignedVec) -> Result<A, DecodeError> {
    let archive = bytes
        .strip_prefix(envelope::<A>().as_slice())
        .ok_or(DecodeError::Foreign { stage: A::STAGE, schema: A::SCHEMA })?;
    let decoded = rkyv::access::<A::Archived, Error>(archive)
        .and_then(|archived| rkyv::deserialize::<A, Error>(archived));
    decoded.map_err(|source| DecodeError::Invalid { stage: A::STAGE, schema: A::SCHEMA, source })
}

/// The bytes in front of every archive of type `A`.
fn envelope<A: Artifact>() -> Vec<u8> {
    let mut bytes = Vec::with_capacity(3 * ALIGNMENT);
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&A::SCHEMA.to_le_bytes());
    bytes.extend_from_slice(&(A::STAGE.len() as u32).to_le_bytes());
    bytes.extend_from_slice(A::STAGE.as_bytes());
    bytes.resize(bytes.len().next_multiple_of(ALIGNMENT), 0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Debug, PartialEq)]
    struct Words(Vec<String>);

    impl Artifact for Words {
        const STAGE: &'static str = "words";
        const VERSION: u32 = 1;
        const SCHEMA: u32 = 2;
    }

    fn words() -> Words {
        Words(vec!["trunk".into(), "a head that is longer".into()])
    }

    #[test]
    fn the_archive_begins_aligned_behind_the_envelope() {
        let bytes = encode(&words()).unwrap();
        let head = envelope::<Words>();
        assert_eq!(head.len(), 32);
        assert!(bytes.starts_with(&head));
        assert!((bytes.as_ptr() as usize).is_multiple_of(ALIGNMENT));
        assert_eq!(decode::<Words>(&bytes).unwrap(), words());
    }

    #[test]
    fn another_stage_or_schema_is_foreign() {
        let bytes = encode(&words()).unwrap();
        for at in [0, 8, 12, 16] {
            let mut other = bytes.clone();
            other[at] ^= 1;
            let error = decode::<Words>(&other).unwrap_err();
            assert!(matches!(error, DecodeError::Foreign { .. }), "byte {at}");
        }
        let nothing = AlignedVec::new();
        assert!(matches!(decode::<Words>(&nothing), Err(DecodeError::Foreign { .. })));
    }

    #[test]
    fn a_damaged_archive_is_an_error_and_nothing_worse() {
        let bytes = encode(&words()).unwrap();
        let head = envelope::<Words>().len();
        let mut refused = 0;
        for at in head..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x80;
            refused += usize::from(decode::<Words>(&damaged).is_err());
        }
        assert!(refused > 0);
        for length in head..bytes.len() {
            let mut cut = AlignedVec::<ALIGNMENT>::new();
            cut.extend_from_slice(&bytes[..length]);
            assert!(matches!(decode::<Words>(&cut), Err(DecodeError::Invalid { .. })));
        }
    }
}
