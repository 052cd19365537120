//! How the bytes of an entry lie in the database: as chunks of 2 KiB, each with its own digest.
//!
//! In: a key and bytes; out: the same bytes, or which chunk is at fault. A chunk's record is a BLAKE3 over its key,
//! its index and its bytes, then the bytes. Chunks of one entry are neighbours in the tree, in order.
//!
//! Why so small: sled writes a page of more than a quarter segment (128 KiB) to a file of its own, which it never
//! syncs and panics without. A leaf page holds up to 16 records, and 19 while it merges with a neighbour, so
//! records up to 6.5 KiB keep every page in the log. And it keeps a page or two in each of the 256 parts of its cache,
//! whatever room it is given: with pages three times as small that is a third of the memory.

use std::fmt;

use rkyv::util::AlignedVec;
use sled::Tree;

use super::CacheKey;
use super::interruption::point;

/// Bytes per chunk; the last one of an entry may be shorter.
pub(super) const CHUNK: usize = 2 << 10;

/// How often the page of a whole chunk is used once more when the chunk was read or written, and that of a smaller one in
/// proportion. sled 0.34 looks for pages to evict
/// only when one part of its cache was used 64 times; a page of chunks is used some 50 times before it is full, and of
/// all that was written in a while little would ever be evicted.
const USES: usize = 16;

const DIGEST: usize = 32;

/// Why a chunk cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ChunkFault {
    Missing { index: u32 },
    Damaged { index: u32 },
}

impl fmt::Display for ChunkFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { index } => write!(f, "chunk {index} is missing"),
            Self::Damaged { index } => write!(f, "chunk {index} does not match its digest"),
        }
    }
}

/// Writes `bytes` as the chunks of `key`. The tree must hold none of that key, see [`remove`].
pub(super) fn write(tree: &Tree, key: &CacheKey, bytes: &[u8]) -> sled::Result<()> {
    let mut record = Vec::with_capacity(DIGEST + CHUNK.min(bytes.len()));
    for (index, chunk) in (0..).zip(bytes.chunks(CHUNK)) {
        record.clear();
        record.extend_from_slice(&digest(key, index, chunk));
        record.extend_from_slice(chunk);
        let address = address(key, index);
        tree.insert(address, record.as_slice())?;
        evict_others(tree, &address, chunk.len())?;
        point()?;
    }
    Ok(())
}

/// Has the database look whether it keeps more pages in memory than it should, beside that of `address`, where there are so many
/// `bytes`.
fn evict_others(tree: &Tree, address: &[u8], bytes: usize) -> sled::Result<()> {
    (0..USES * bytes / CHUNK).try_for_each(|_| tree.contains_key(address).map(drop))
}

/// Reads the `length` bytes of `key` back, each chunk checked against its digest and for its length.
pub(super) fn read(
    tree: &Tree,
    key: &CacheKey,
    length: u64,
) -> sled::Result<Result<AlignedVec, ChunkFault>> {
    // The length comes from a checked manifest, yet memory is taken only as chunks turn up.
    let mut bytes = AlignedVec::<16>::new();
    let mut index = 0;
    while (bytes.len() as u64) < length {
        let wanted = (length - bytes.len() as u64).min(CHUNK as u64) as usize;
        let address = address(key, index);
        let Some(record) = tree.get(address)? else {
            return Ok(Err(ChunkFault::Missing { index }));
        };
        evict_others(tree, &address, record.len())?;
        match record.split_first_chunk::<DIGEST>() {
            Some((found, chunk))
                if chunk.len() == wanted && *found == digest(key, index, chunk) =>
            {
                bytes.extend_from_slice(chunk);
            }
            _ => return Ok(Err(ChunkFault::Damaged { index })),
        }
        index += 1;
    }
    Ok(Ok(bytes))
}

/// Removes whatever chunks `key` has.
pub(super) fn remove(tree: &Tree, key: &CacheKey) -> sled::Result<()> {
    for address in tree.scan_prefix(key.as_bytes()).keys() {
        tree.remove(address?)?;
        point()?;
    }
    Ok(())
}

/// Where a chunk lies: the key, then the index in big-endian order, which is the order of the tree.
fn address(key: &CacheKey, index: u32) -> [u8; 36] {
    let mut address = [0; 36];
    address[..32].copy_from_slice(key.as_bytes());
    address[32..].copy_from_slice(&index.to_be_bytes());
    address
}

fn digest(key: &CacheKey, index: u32, chunk: &[u8]) -> [u8; DIGEST] {
    let mut hasher = blake3::Hasher::new_derive_key("chladni store 1 chunk");
    hasher.update(&address(key, index));
    hasher.update(chunk);
    *hasher.finalize().as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree() -> Tree {
        let db = sled::Config::new().temporary(true).open().unwrap();
        db.open_tree("chunks").unwrap()
    }

    fn sample(length: usize) -> Vec<u8> {
        (0..length).map(|i| (i * 7 + i / 251) as u8).collect()
    }

    #[test]
    fn every_length_around_a_chunk_comes_back() {
        let tree = tree();
        for (n, length) in
            [0, 1, CHUNK - 1, CHUNK, CHUNK + 1, 64 << 10, 300 << 10].into_iter().enumerate()
        {
            let key = CacheKey::from_bytes([n as u8; 32]);
            let bytes = sample(length);
            write(&tree, &key, &bytes).unwrap();
            assert_eq!(tree.scan_prefix(key.as_bytes()).count(), length.div_ceil(CHUNK));
            let back = read(&tree, &key, length as u64).unwrap().unwrap();
            assert_eq!(back.as_slice(), bytes);
            assert!(length == 0 || (back.as_ptr() as usize).is_multiple_of(16));
        }
    }

    #[test]
    fn a_chunk_is_bound_to_its_key_its_index_and_its_length() {
        let tree = tree();
        let (key, other) = (CacheKey::from_bytes([1; 32]), CacheKey::from_bytes([2; 32]));
        let length = 3 * CHUNK as u64;
        let fault = || read(&tree, &key, length).unwrap().unwrap_err();
        assert_eq!(fault(), ChunkFault::Missing { index: 0 });
        write(&tree, &key, &sample(3 * CHUNK)).unwrap();
        write(&tree, &other, &sample(3 * CHUNK)).unwrap();

        let second = tree.get(address(&key, 1)).unwrap().unwrap();
        tree.insert(address(&key, 0), &second).unwrap();
        assert_eq!(fault(), ChunkFault::Damaged { index: 0 });

        let first_of_other = tree.get(address(&other, 0)).unwrap().unwrap();
        tree.insert(address(&key, 0), &first_of_other).unwrap();
        assert_eq!(fault(), ChunkFault::Damaged { index: 0 });

        remove(&tree, &key).unwrap();
        assert_eq!(fault(), ChunkFault::Missing { index: 0 });
        assert_eq!(
            read(&tree, &other, length - 1).unwrap().unwrap_err(),
            ChunkFault::Damaged { index: 2 }
        );
        assert!(read(&tree, &other, length).unwrap().is_ok());
    }
}
