//! Named arrays as one npz archive, which `np.load` reads without pickle.
//!
//! All is little-endian and uncompressed, with fixed time stamps in the archive: equal arrays are equal bytes.

use std::io::{self, BufWriter, Cursor, Write};

use npyz::npz::NpzWriter;
use npyz::zip::{CompressionMethod, DateTime, write::FileOptions};
use npyz::{DType, WriterBuilder};

/// Above this many bytes an array is announced as large (zip64), leaving room for its header.
const LARGE: usize = u32::MAX as usize - (1 << 16);

/// An archive that is being filled.
pub struct Arrays(NpzWriter<Cursor<Vec<u8>>>);

impl Arrays {
    /// An empty one.
    pub fn new() -> Self {
        Self(NpzWriter::new(Cursor::new(Vec::new())))
    }

    /// Adds an array of float64, its items in C order.
    pub fn floats(&mut self, name: &str, shape: &[usize], items: impl IntoIterator<Item = f64>) {
        self.array(name, "<f8", shape, items.into_iter());
    }

    /// Adds an array of int64, its items in C order.
    pub fn integers(&mut self, name: &str, shape: &[usize], items: impl IntoIterator<Item = i64>) {
        self.array(name, "<i8", shape, items.into_iter());
    }

    /// Adds an array of int32, its items in C order.
    pub fn short_integers(&mut self, name: &str, items: impl ExactSizeIterator<Item = i32>) {
        self.array(name, "<i4", &[items.len()], items);
    }

    /// Adds a zero-dimensional array of text, which is a `str` for numpy.
    pub fn text(&mut self, name: &str, value: &str) {
        let length = value.chars().count();
        self.array(name, &format!("<U{length}"), &[], std::iter::once(value.to_owned()));
    }

    /// The bytes of the archive.
    pub fn into_bytes(mut self) -> Vec<u8> {
        let finished = self.0.zip_writer().finish();
        finished.expect("memory takes any bytes, and large arrays are announced").into_inner()
    }

    fn array<T: npyz::Serialize>(
        &mut self,
        name: &str,
        dtype: &str,
        shape: &[usize],
        items: impl Iterator<Item = T>,
    ) {
        self.write(name, dtype, shape, items)
            .expect("memory takes any bytes, and large arrays are announced");
    }

    fn write<T: npyz::Serialize>(
        &mut self,
        name: &str,
        dtype: &str,
        shape: &[usize],
        items: impl Iterator<Item = T>,
    ) -> io::Result<()> {
        let dtype = DType::Plain(dtype.parse().expect("the types named in this file are numpy's"));
        let bytes = shape.iter().fold(dtype.num_bytes().unwrap_or(0), |b, &l| b.saturating_mul(l));
        let options = FileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .last_modified_time(DateTime::default())
            .large_file(bytes > LARGE);
        let zip = self.0.zip_writer();
        zip.start_file(npyz::npz::file_name_from_array_name(name), options)?;
        let shape: Vec<u64> = shape.iter().map(|&length| length as u64).collect();
        let mut buffered = BufWriter::with_capacity(1 << 16, zip);
        let options = npyz::WriteOptions::new().dtype(dtype).shape(&shape);
        let mut writer = options.writer(&mut buffered).begin_nd()?;
        writer.extend(items)?;
        writer.finish()?;
        buffered.flush()
    }
}
