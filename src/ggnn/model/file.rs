//! A model as a safetensors file, little-endian, which other programs can open too.
//!
//! ```text
//! __metadata__.chladni      JSON: schema, description, sizes and heads of every trunk
//! phi<k>.trunk.<i>          f32, r×c: the trunk's weights in the order of Trunk::weights
//! phi<k>.history            f64: the Rayleigh quotient at every step of its training
//! phi<k>.head               f64, h or h + 1: w_out, and b_out where the recipe has one
//! phi<k>.quotients          f64, 2: the Rayleigh quotient before training and after it
//! checksum                  u8, 32: BLAKE3 of the metadata and of all tensors above
//! ```
//! A trunk and its history stand under the first eigenfunction that has its head there. One model has one sequence of bytes. Nothing in a file is believed before it is checked: the length against that of
//! the file, then the schema, then every size, then the checksum.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use safetensors::tensor::{Dtype, SafeTensors, View};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Description, Model};
use crate::ggnn::block::{Block, Check, TrainingRecord};
use crate::ggnn::network::{TrunkShape, parameter_sizes};

/// The schema that this code reads and writes.
pub const SCHEMA: &str = "chladni-model-1";

/// The key of our metadata.
const METADATA: &str = "chladni";

/// A header has no more bytes than this: those of ten thousand blocks.
const LARGEST_HEADER: u64 = 16 << 20;

/// A file that is not a model that we can use.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", path.display())]
pub struct ModelFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub fault: ModelFault,
}

/// What is wrong with the bytes of a model.
#[derive(Debug, thiserror::Error)]
pub enum ModelFault {
    /// The system refuses to read it.
    #[error(
        "the model cannot be read ({0}); give a file that `chladni model export` wrote, or a name of `chladni model list`"
    )]
    Unreadable(io::Error),
    /// It does not begin as a safetensors file does.
    #[error("this is no safetensors file; give a file that `chladni model export` wrote")]
    NotSafetensors,
    /// It is shorter or longer than it says.
    #[error(
        "the file has {found} bytes and announces {expected}: it was cut off or damaged; copy or export it again"
    )]
    Length { expected: u64, found: u64 },
    /// It holds something else.
    #[error(
        "a safetensors file, but without chladni's metadata: it holds no eigenfunctions; \
         give a file that `chladni model export` wrote"
    )]
    Foreign,
    /// It was written by another version.
    #[error(
        "the model has the schema {found:?}, and this chladni reads {SCHEMA:?}; use the version of chladni that wrote \
         it, or train the model again and export it"
    )]
    Schema { found: String },
    /// Metadata or sizes that contradict one another.
    #[error("the file is damaged: {0}; copy or export it again")]
    Damaged(String),
}

/// What stands in the metadata.
#[derive(Serialize, Deserialize)]
struct Header<'a> {
    schema: Cow<'a, str>,
    description: Cow<'a, Description>,
    /// In the order of their eigenfunctions.
    trunks: Vec<TrunkHeader>,
}

/// A trunk.
#[derive(Serialize, Deserialize)]
struct TrunkHeader {
    /// How many eigenfunctions have their heads on it.
    heads: usize,
    shape: TrunkShape,
}

/// The schema alone, which every version can read.
#[derive(Deserialize)]
struct Schema {
    schema: String,
}

impl Model {
    /// The bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let header = Header {
            schema: SCHEMA.into(),
            description: Cow::Borrowed(&self.description),
            trunks: self.trunks().map(TrunkHeader::of).collect(),
        };
        let header = serde_json::to_string(&header).expect("a description is numbers and names");
        let mut tensors = self.tensors();
        let sum = checksum(
            &header,
            tensors.iter().map(|(name, tensor)| (name.as_str(), tensor.data.as_slice())),
        );
        tensors.push((
            CHECKSUM.into(),
            Tensor { dtype: Dtype::U8, shape: vec![32], data: sum.to_vec() },
        ));
        let metadata = HashMap::from([(METADATA.to_string(), header)]);
        safetensors::serialize(tensors, &Some(metadata))
            .expect("the tensors are as long as their sizes say")
    }

    /// Reads what [`Self::to_bytes`] wrote. Any bytes are safe to pass.
    ///
    /// # Errors
    /// [`ModelFault`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelFault> {
        let length = header_length(bytes, bytes.len() as u64)?;
        let text = metadata(&bytes[8..8 + length], bytes.len() as u64)?;
        let tensors = SafeTensors::deserialize(bytes).map_err(damaged)?;
        let Header { description, trunks, .. } = serde_json::from_str(&text).map_err(damaged)?;
        let reader = Reader(&tensors);
        let mut blocks = Vec::new();
        let reads = description.features.inputs();
        for trunk in trunks {
            if reads != Some(trunk.shape.inputs) {
                return Err(damaged("a trunk does not take the features that the model reads"));
            }
            let first = description.known.saturating_add(1 + blocks.len());
            blocks.extend(reader.blocks(first, &trunk)?);
        }
        let model = Self { description: description.into_owned(), blocks };
        let found = reader.bytes(CHECKSUM, Dtype::U8, &[32])?;
        let sound = {
            let tensors = model.tensors();
            let named =
                tensors.iter().map(|(name, tensor)| (name.as_str(), tensor.data.as_slice()));
            checksum(&text, named).as_slice() == found
        };
        if sound { Ok(model) } else { Err(damaged("its checksum does not match")) }
    }

    /// Reads the file at `path`. A file that is no model is refused by its first bytes, however long it is.
    ///
    /// # Errors
    /// [`ModelFileError`].
    pub fn load(path: &Path) -> Result<Self, ModelFileError> {
        read(path)
            .and_then(|bytes| Self::from_bytes(&bytes))
            .map_err(|fault| ModelFileError { path: path.to_owned(), fault })
    }

    /// All tensors but the checksum, in the order that it takes them in.
    fn tensors(&self) -> Vec<(String, Tensor)> {
        let mut tensors = Vec::new();
        let mut k = self.description.known;
        for heads in self.trunks() {
            tensors.extend(trunk_tensors(k + 1, &heads[0]));
            for Block { head, record, .. } in heads {
                k += 1;
                let quotients = [record.untrained, record.trained];
                tensors.push((format!("phi{k}.head"), Tensor::of_doubles(head)));
                tensors.push((format!("phi{k}.quotients"), Tensor::of_doubles(&quotients)));
            }
        }
        tensors
    }
}

/// The trunk of φ_k and how it was trained.
fn trunk_tensors(k: usize, Block { shape, weights, record, .. }: &Block) -> Vec<(String, Tensor)> {
    let parameters = weights.iter().zip(parameter_sizes(*shape)).enumerate();
    let parameters = parameters.map(|(i, (weights, (rows, columns)))| {
        let data = weights.iter().flat_map(|w| w.to_le_bytes()).collect();
        let tensor = Tensor { dtype: Dtype::F32, shape: vec![rows, columns], data };
        (format!("phi{k}.trunk.{i}"), tensor)
    });
    let history = (format!("phi{k}.history"), Tensor::of_doubles(&record.history));
    // Only where there are any: other models have the file that they had before anything could be held out.
    let held_out: Vec<f64> =
        record.held_out.iter().flat_map(|check| [check.step as f64, check.loss]).collect();
    let held_out = (format!("phi{k}.held_out"), Tensor::of_doubles(&held_out));
    let held_out = (!record.held_out.is_empty()).then_some(held_out);
    parameters.chain([history]).chain(held_out).collect()
}

impl TrunkHeader {
    fn of(heads: &[Block]) -> Self {
        Self { heads: heads.len(), shape: heads[0].shape }
    }
}

const CHECKSUM: &str = "checksum";

fn checksum<'a>(header: &str, tensors: impl Iterator<Item = (&'a str, &'a [u8])>) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new_derive_key("chladni model 1");
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(header.as_bytes());
    for (name, data) in tensors {
        part(name.as_bytes());
        part(data);
    }
    *hasher.finalize().as_bytes()
}

struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    data: Vec<u8>,
}

impl Tensor {
    fn of_doubles(values: &[f64]) -> Self {
        let data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        Self { dtype: Dtype::F64, shape: vec![values.len()], data }
    }
}

impl View for Tensor {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.data)
    }

    fn data_len(&self) -> usize {
        self.data.len()
    }
}

struct Reader<'a>(&'a SafeTensors<'a>);

impl Reader<'_> {
    /// The blocks of a trunk, the first of them for φ_k.
    fn blocks(&self, k: usize, trunk: &TrunkHeader) -> Result<Vec<Block>, ModelFault> {
        let &TrunkHeader { heads, shape } = trunk;
        // Before anything is allocated by what a size says.
        if shape.layers > self.0.len() || heads > self.0.len() || heads == 0 {
            let layers = shape.layers;
            return Err(damaged(format!("φ{k} announces {layers} layers and {heads} heads")));
        }
        let sizes = parameter_sizes(shape).into_iter().enumerate();
        let weights = sizes.map(|(i, (rows, columns))| {
            let data = self.bytes(&format!("phi{k}.trunk.{i}"), Dtype::F32, &[rows, columns])?;
            Ok(data.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect())
        });
        let weights = Arc::new(weights.collect::<Result<Vec<_>, ModelFault>>()?);
        let history = self.doubles(&format!("phi{k}.history"))?;
        let held_out = self.held_out(k)?;
        let block = |k| {
            let (head, [untrained, trained]) = self.head(k, shape)?;
            let (history, held_out) = (history.clone(), held_out.clone());
            let record = TrainingRecord { history, untrained, trained, held_out };
            Ok(Block { shape, weights: weights.clone(), head, record })
        };
        (k..).take(heads).map(block).collect()
    }

    /// What the training of φ_k's trunk found on members that were held out: none, unless the file says so.
    fn held_out(&self, k: usize) -> Result<Vec<Check>, ModelFault> {
        let name = format!("phi{k}.held_out");
        if self.0.tensor(&name).is_err() {
            return Ok(Vec::new());
        }
        let numbers = self.doubles(&name)?;
        let (checks, rest) = numbers.as_chunks();
        if !rest.is_empty() || checks.iter().any(|[step, _]| (*step as usize) as f64 != *step) {
            return Err(damaged(format!("{name} is no list of steps and losses")));
        }
        Ok(checks.iter().map(|&[step, loss]| Check { step: step as usize, loss }).collect())
    }

    /// w_out of φ_k, and its quotients before and after training.
    fn head(&self, k: usize, shape: TrunkShape) -> Result<(Vec<f64>, [f64; 2]), ModelFault> {
        let head = self.doubles(&format!("phi{k}.head"))?;
        if ![shape.width, shape.width + 1].contains(&head.len()) {
            return Err(damaged(format!(
                "φ{k} has {} features and {} weights in its head",
                shape.width,
                head.len()
            )));
        }
        let quotients = self.doubles(&format!("phi{k}.quotients"))?;
        let &[untrained, trained] = quotients.as_slice() else {
            return Err(damaged(format!("the training record of φ{k} is incomplete")));
        };
        Ok((head, [untrained, trained]))
    }

    fn doubles(&self, name: &str) -> Result<Vec<f64>, ModelFault> {
        let shape = self.0.tensor(name).map_err(damaged)?.shape().to_vec();
        let [length] = shape.as_slice() else {
            return Err(damaged(format!("{name} is no vector")));
        };
        let data = self.bytes(name, Dtype::F64, &[*length])?;
        Ok(data.as_chunks().0.iter().map(|&bytes| f64::from_le_bytes(bytes)).collect())
    }

    fn bytes(&self, name: &str, dtype: Dtype, shape: &[usize]) -> Result<&[u8], ModelFault> {
        let tensor = self.0.tensor(name).map_err(damaged)?;
        if tensor.dtype() != dtype || tensor.shape() != shape {
            let (found, of) = (tensor.shape(), tensor.dtype());
            return Err(damaged(format!(
                "{name} has sizes {found:?} of {of:?} in place of {shape:?} of {dtype:?}"
            )));
        }
        Ok(tensor.data())
    }
}

fn damaged(reason: impl ToString) -> ModelFault {
    ModelFault::Damaged(reason.to_string())
}

/// The bytes of a file, if its header is that of a model.
fn read(path: &Path) -> Result<Vec<u8>, ModelFault> {
    let mut file = File::open(path).map_err(ModelFault::Unreadable)?;
    let known = file.metadata().map_err(ModelFault::Unreadable)?;
    if !known.is_file() {
        return Err(ModelFault::Unreadable(io::Error::other("it is not a regular file")));
    }
    let mut bytes = Vec::new();
    let mut more = |bytes: &mut Vec<u8>, count: u64| {
        (&mut file).take(count).read_to_end(bytes).map_err(ModelFault::Unreadable)
    };
    more(&mut bytes, 8)?;
    let length = header_length(&bytes, known.len())?;
    more(&mut bytes, length as u64)?;
    let header = bytes.get(8..8 + length).ok_or(ModelFault::NotSafetensors)?;
    metadata(header, known.len())?;
    more(&mut bytes, u64::MAX)?;
    Ok(bytes)
}

/// The length of the JSON header of a file of `total` bytes, from its first eight.
fn header_length(start: &[u8], total: u64) -> Result<usize, ModelFault> {
    let first = start.first_chunk().ok_or(ModelFault::NotSafetensors)?;
    let length = u64::from_le_bytes(*first);
    if !(2..=LARGEST_HEADER).contains(&length) {
        return Err(ModelFault::NotSafetensors);
    }
    if length > total.saturating_sub(8) {
        return Err(ModelFault::Length { expected: 8 + length, found: total });
    }
    Ok(length as usize)
}

/// Our metadata, from the header of a file of `total` bytes; its length and its schema are as they should be.
fn metadata(header: &[u8], total: u64) -> Result<String, ModelFault> {
    let before_data = 8 + header.len() as u64;
    let header: HashMap<String, Value> =
        serde_json::from_slice(header).map_err(|_| ModelFault::NotSafetensors)?;
    let text = header.get("__metadata__").and_then(|map| map.get(METADATA)?.as_str());
    let text = text.ok_or(ModelFault::Foreign)?;
    let Schema { schema } = serde_json::from_str(text).map_err(damaged)?;
    if schema != SCHEMA {
        return Err(ModelFault::Schema { found: schema });
    }
    let end = header.values().filter_map(|tensor| tensor.get("data_offsets")?.get(1)?.as_u64());
    let expected = end.max().unwrap_or(0).saturating_add(before_data);
    if expected != total {
        return Err(ModelFault::Length { expected, found: total });
    }
    Ok(text.to_string())
}

#[cfg(test)]
mod tests {
    use super::super::samples::{shared_model, sphere_model, sphere_model_reading};
    use super::*;
    use crate::ggnn::features::{FeatureOptions, Features, Input};
    use crate::mesh::sample::icosphere;

    #[test]
    fn a_model_comes_back_and_has_one_sequence_of_bytes() {
        let model = sphere_model();
        let bytes = model.to_bytes();
        let back = Model::from_bytes(&bytes).unwrap();
        assert_eq!(back, model);
        assert_eq!(back.to_bytes(), bytes);
        let other = SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(other.tensor("phi2.trunk.0").unwrap().shape(), [4, 3]);
        assert_eq!(other.tensor("phi3.head").unwrap().dtype(), Dtype::F64);
    }

    #[test]
    fn the_weights_of_a_shared_trunk_are_there_once() {
        let model = shared_model();
        let bytes = model.to_bytes();
        let back = Model::from_bytes(&bytes).unwrap();
        assert_eq!(back, model);
        assert!(back.blocks[1].shares_trunk(&back.blocks[2]));
        assert!(!back.blocks[0].shares_trunk(&back.blocks[1]));
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        assert!(tensors.tensor("phi3.trunk.0").is_ok() && tensors.tensor("phi4.head").is_ok());
        assert!(tensors.tensor("phi4.trunk.0").is_err() && tensors.tensor("phi4.history").is_err());
    }

    #[test]
    fn landmarks_come_back_to_the_last_bit() {
        let options = FeatureOptions { input: Input::Landmarks, ..FeatureOptions::default() };
        let model = sphere_model_reading(Features::of(&icosphere(1), options));
        let back = Model::from_bytes(&model.to_bytes()).unwrap();
        assert_eq!(back, model);
        assert_eq!(back.description.features.inputs(), Some(16));
    }

    #[test]
    fn every_cut_is_refused_in_memory_and_on_disk() {
        let bytes = sphere_model().to_bytes();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cut.safetensors");
        for length in 0..bytes.len() {
            let refused = Model::from_bytes(&bytes[..length]).unwrap_err();
            let expected = if length < 8 {
                matches!(refused, ModelFault::NotSafetensors)
            } else {
                matches!(refused, ModelFault::Length { found, .. } if found == length as u64)
            };
            assert!(expected, "{length}: {refused}");
            if length % 97 == 0 {
                std::fs::write(&path, &bytes[..length]).unwrap();
                let from_disk = Model::load(&path).unwrap_err();
                assert_eq!(from_disk.fault.to_string(), refused.to_string());
            }
        }
        let longer = [&bytes[..], &[0]].concat();
        assert!(matches!(Model::from_bytes(&longer), Err(ModelFault::Length { .. })));
    }

    #[test]
    fn no_flipped_bit_goes_unnoticed() {
        let bytes = sphere_model().to_bytes();
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            // Spaces pad the header, and say nothing.
            if let Ok(model) = Model::from_bytes(&damaged) {
                assert_eq!(model, sphere_model(), "byte {at}");
                assert!(bytes[at].is_ascii_whitespace(), "byte {at}");
            }
        }
    }

    /// A file with this header and so many bytes of data.
    fn with_header(header: &str, data: usize) -> Vec<u8> {
        let length = (header.len() as u64).to_le_bytes();
        [&length[..], header.as_bytes(), &vec![0; data]].concat()
    }

    #[test]
    fn absurd_sizes_are_refused_before_anything_is_allocated() {
        for length in [u64::MAX, 1 << 60, LARGEST_HEADER + 1, 0, 1] {
            let bytes = [&length.to_le_bytes()[..], b"{}"].concat();
            assert!(matches!(Model::from_bytes(&bytes), Err(ModelFault::NotSafetensors)));
        }
        let honest = String::from_utf8_lossy(&sphere_model().to_bytes()).into_owned();
        let ours = honest.split_once("__metadata__\":").unwrap().1.split_once("},\"phi").unwrap().0;
        let bytes = |ours: &str, shape: &str, end: &str| {
            let tensor = format!(r#"{{"dtype":"F32","shape":{shape},"data_offsets":[0,{end}]}}"#);
            with_header(&format!(r#"{{"__metadata__":{ours}}},"phi2.trunk.0":{tensor}}}"#), 48)
        };
        let refused = |bytes: &[u8]| Model::from_bytes(bytes).unwrap_err();
        let huge = u64::MAX.to_string();
        assert!(matches!(refused(&bytes(ours, "[4,3]", &huge)), ModelFault::Length { .. }));
        let huge = (1_u64 << 62).to_string();
        assert!(matches!(
            refused(&bytes(ours, &format!("[{huge},{huge}]"), "48")),
            ModelFault::Damaged(_)
        ));
        assert!(matches!(refused(&bytes(ours, "[4,3]", "48")), ModelFault::Damaged(_)));
        for (size, absurd) in [("layers", "1"), ("width", "4"), ("heads", "1")] {
            let [from, to] = [absurd, &huge].map(|v| format!(r#"\"{size}\":{v}"#));
            let lying = ours.replace(&from, &to);
            assert_ne!(lying, ours);
            assert!(matches!(refused(&bytes(&lying, "[4,3]", "48")), ModelFault::Damaged(_)));
        }
    }

    #[test]
    fn other_files_are_told_apart() {
        let refused = |bytes: &[u8]| Model::from_bytes(bytes).unwrap_err();
        assert!(matches!(refused(b"v 0 0 0\nv 1 0 0\n"), ModelFault::NotSafetensors));
        let weights = r#"{"w":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#;
        assert!(matches!(refused(&with_header(weights, 8)), ModelFault::Foreign));
        let newer = r#"{"__metadata__":{"chladni":"{\"schema\":\"chladni-model-9\"}"}}"#;
        let newer = refused(&with_header(newer, 0)).to_string();
        assert!(newer.contains("chladni-model-9") && newer.contains("export"), "{newer}");
        let missing = Model::load("nowhere.safetensors".as_ref()).unwrap_err().to_string();
        assert!(missing.starts_with("nowhere.safetensors: ") && missing.contains("model list"));
        let folder = Model::load("src".as_ref()).unwrap_err().to_string();
        assert!(folder.contains("not a regular file"), "{folder}");
    }
}
