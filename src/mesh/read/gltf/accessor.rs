//! The numbers behind an accessor: positions and indices, every offset and count checked against the bytes.
//!
//! The iterators of the `gltf` crate trust counts and offsets; a damaged file makes them panic. These do not.

use gltf::accessor::sparse::{IndexType, Sparse};
use gltf::accessor::{DataType, Dimensions};
use gltf::{Accessor, buffer::View};

use super::buffers::Buffers;
use crate::mesh::error::Fault;

/// How many positions, indices and primitives may come of a byte of input: instances of a mesh, and accessors
/// over nothing, make more of them than the file holds.
const PER_BYTE: usize = 2;

/// As many may come of any file: small ones hold scenes of many equal parts.
const AT_LEAST: usize = 1 << 18;

/// How much may still be made of a scene.
pub struct Budget {
    /// The size of its document, and of the files beside it.
    bytes: usize,
    limit: usize,
    left: usize,
}

impl Budget {
    fn of(bytes: usize) -> Self {
        let limit = bytes.saturating_mul(PER_BYTE).max(AT_LEAST);
        Self { bytes, limit, left: limit }
    }

    /// Takes note that so many positions, indices or primitives come to the others.
    pub fn spend(&mut self, count: usize) -> Result<(), Fault> {
        let too_many = Fault::TooManyInstances { limit: self.limit, bytes: self.bytes };
        self.left = self.left.checked_sub(count).ok_or(too_many)?;
        Ok(())
    }
}

/// The buffers of a document, and how much may still be read from them.
pub struct Data {
    buffers: Buffers,
    pub budget: Budget,
}

impl Data {
    /// `document` is the size in bytes of the document with all that is in it.
    pub fn new(buffers: Buffers, document: usize) -> Self {
        let budget = Budget::of(document + buffers.beside());
        Self { buffers, budget }
    }

    /// Positions, in double precision and not yet transformed.
    pub fn positions(&mut self, accessor: &Accessor<'_>) -> Result<Vec<[f64; 3]>, Fault> {
        if (accessor.data_type(), accessor.dimensions()) != (DataType::F32, Dimensions::Vec3) {
            return Err(fault(
                accessor,
                "positions are not three floats; export without quantisation",
            ));
        }
        let mut positions = self.read(accessor, position)?;
        if let Some(sparse) = accessor.sparse() {
            self.replace(accessor, &sparse, &mut positions)?;
        }
        Ok(positions)
    }

    /// Vertex indices.
    pub fn indices(&mut self, accessor: &Accessor<'_>) -> Result<Vec<u32>, Fault> {
        if accessor.sparse().is_some() {
            return Err(fault(accessor, "sparse indices are not read; export again"));
        }
        match (accessor.data_type(), accessor.dimensions()) {
            (DataType::U8, Dimensions::Scalar) => self.read(accessor, |b: &[u8; 1]| b[0].into()),
            (DataType::U16, Dimensions::Scalar) => {
                self.read(accessor, |b: &[u8; 2]| u16::from_le_bytes(*b).into())
            }
            (DataType::U32, Dimensions::Scalar) => {
                self.read(accessor, |b: &[u8; 4]| u32::from_le_bytes(*b))
            }
            _ => Err(fault(accessor, "indices are not unsigned integers")),
        }
    }

    fn read<T: Clone + Default, const SIZE: usize>(
        &mut self,
        accessor: &Accessor<'_>,
        parse: impl Fn(&[u8; SIZE]) -> T,
    ) -> Result<Vec<T>, Fault> {
        let count = accessor.count();
        let Some(view) = accessor.view() else {
            if count > self.budget.limit {
                return Err(fault(accessor, "its count is far larger than the file"));
            }
            self.budget.spend(count)?;
            return Ok(vec![T::default(); count]);
        };
        self.elements(accessor, &view, accessor.offset(), count, parse)
    }

    /// `count` elements of `SIZE` bytes, `offset` bytes into a view.
    fn elements<T, const SIZE: usize>(
        &mut self,
        accessor: &Accessor<'_>,
        view: &View<'_>,
        offset: usize,
        count: usize,
        parse: impl Fn(&[u8; SIZE]) -> T,
    ) -> Result<Vec<T>, Fault> {
        let bytes = self
            .buffers
            .view(view)
            .and_then(|bytes| bytes.get(offset..))
            .ok_or_else(|| fault(accessor, "it starts outside its buffer"))?;
        let stride = view.stride().unwrap_or(SIZE);
        let available = match bytes.len().checked_sub(SIZE) {
            Some(rest) => rest / stride + 1,
            None => 0,
        };
        if count > available {
            let problem = format!(
                "{count} elements are promised and {available} are there; the buffer is cut short"
            );
            return Err(fault(accessor, &problem));
        }
        self.budget.spend(count)?;
        Ok((0..count).filter_map(|i| bytes.get(i * stride..)?.first_chunk()).map(parse).collect())
    }

    /// Puts the values of a sparse accessor in their places.
    fn replace(
        &mut self,
        accessor: &Accessor<'_>,
        sparse: &Sparse<'_>,
        positions: &mut [[f64; 3]],
    ) -> Result<(), Fault> {
        let (at, values, count) = (sparse.indices(), sparse.values(), sparse.count());
        let (view, offset) = (at.view(), at.offset());
        let at: Vec<u32> = match at.index_type() {
            IndexType::U8 => {
                self.elements(accessor, &view, offset, count, |b: &[u8; 1]| b[0].into())
            }
            IndexType::U16 => self.elements(accessor, &view, offset, count, |b: &[u8; 2]| {
                u16::from_le_bytes(*b).into()
            }),
            IndexType::U32 => {
                self.elements(accessor, &view, offset, count, |b: &[u8; 4]| u32::from_le_bytes(*b))
            }
        }?;
        let values: Vec<[f64; 3]> =
            self.elements(accessor, &values.view(), values.offset(), count, position)?;
        for (index, value) in at.into_iter().zip(values) {
            *positions
                .get_mut(index as usize)
                .ok_or_else(|| fault(accessor, "a sparse index is out of range"))? = value;
        }
        Ok(())
    }
}

fn position(bytes: &[u8; 12]) -> [f64; 3] {
    let [a, b, c, d, e, f, g, h, i, j, k, l] = *bytes;
    [[a, b, c, d], [e, f, g, h], [i, j, k, l]].map(|word| f64::from(f32::from_le_bytes(word)))
}

fn fault(accessor: &Accessor<'_>, problem: &str) -> Fault {
    Fault::Accessor { accessor: accessor.index(), problem: problem.to_owned() }
}
