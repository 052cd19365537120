//! glTF 2.0 (`.gltf` and `.glb`): the triangles of the scene, each mesh where its nodes put it. Every node with a mesh is an object.
//!
//! Only geometry is looked at: triangles, strips and fans of floating-point positions, with and without
//! indices, interleaved or sparse. Materials, animations, morph targets and skins change nothing; a skinned
//! mesh is taken in its bind pose. Compressed and quantised meshes are refused by name.

mod accessor;
mod beside;
mod buffers;
mod document;
mod transform;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use gltf::{Accessor, Document, Node, Primitive, mesh::Mode};

use self::accessor::Data;
use self::buffers::Buffers;
use self::transform::Affine;
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{RawMesh, SameVertex, number, strip_corners};

pub use beside::companions;

/// Reads a document; its buffers lie inside it or in files beside `path`.
pub fn read(bytes: &[u8], path: &Path) -> Result<RawMesh, Failure> {
    let (document, blob) = document::parse(bytes)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let data = Data::new(Buffers::resolve(&document, blob, folder)?, bytes.len());
    let mut walk = Walk { data, raw: RawMesh::new(SameVertex::Position) };
    walk.scene(&document)?;
    Ok(walk.raw)
}

struct Walk {
    data: Data,
    raw: RawMesh,
}

impl Walk {
    /// The default scene, or all scenes where none is named, depth first, children in their order.
    fn scene(&mut self, document: &Document) -> Result<(), Failure> {
        let roots: Vec<Node<'_>> = match document.default_scene() {
            Some(scene) => scene.nodes().collect(),
            None => document.scenes().flat_map(|scene| scene.nodes()).collect(),
        };
        // Several scenes may show the same root; within a tree every node is met once.
        let mut shown = HashSet::new();
        let mut pending: Vec<_> = roots
            .into_iter()
            .filter(|root| shown.insert(root.index()))
            .map(|root| (root, Affine::IDENTITY))
            .rev()
            .collect();
        let mut met = HashSet::new();
        while let Some((node, parent)) = pending.pop() {
            if !met.insert(node.index()) {
                return Err(Fault::NotATree { node: node.index() }.into());
            }
            let placed = parent.then(&Affine::of(&node.transform()));
            self.node(&node, &placed)?;
            let first_child = pending.len();
            pending.extend(node.children().map(|child| (child, placed)));
            pending[first_child..].reverse();
        }
        Ok(())
    }

    fn node(&mut self, node: &Node<'_>, placed: &Affine) -> Result<(), Failure> {
        let Some(mesh) = node.mesh() else {
            return Ok(());
        };
        // Many nodes may show one mesh, which may have a long name.
        let name = node.name().or(mesh.name());
        let first = |name: &str| name[..name.floor_char_boundary(LONGEST_NAME)].to_owned();
        self.raw.begin_object(name.map(first));
        // Primitives of a mesh often share their positions.
        let mut seen = HashMap::new();
        for primitive in mesh.primitives() {
            let (mesh, index) = (number(mesh.index())?, number(primitive.index())?);
            let place = Place::Primitive { mesh, primitive: index };
            self.data.budget.spend(1)?;
            if !is_surface(primitive.mode()) {
                self.raw.left_out.push(place);
                continue;
            }
            let positions = primitive
                .get(&gltf::Semantic::Positions)
                .ok_or_else(|| Fault::InvalidDocument(format!("{place} has no POSITION")))?;
            let count = positions.count();
            let first = match seen.get(&positions.index()) {
                Some(&first) => first,
                None => {
                    *seen.entry(positions.index()).or_insert(self.positions(&positions, placed)?)
                }
            };
            self.primitive(&primitive, place, first, count, placed)?;
        }
        Ok(())
    }

    /// Appends the transformed positions of an accessor; returns the index of the first.
    fn positions(&mut self, accessor: &Accessor<'_>, placed: &Affine) -> Result<u32, Failure> {
        let first = number(self.raw.positions.len())?;
        let read = self.data.positions(accessor)?;
        let accessor = number(accessor.index())?;
        for (position, element) in read.into_iter().zip(0..) {
            self.raw.position(placed.apply(position), Place::Element { accessor, element })?;
        }
        Ok(first)
    }

    fn primitive(
        &mut self,
        primitive: &Primitive<'_>,
        place: Place,
        first: u32,
        count: usize,
        placed: &Affine,
    ) -> Result<(), Failure> {
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => self.data.indices(&accessor)?,
            None => {
                self.data.budget.spend(count)?;
                (0..number(count)?).collect()
            }
        };
        let mode = primitive.mode();
        if indices.len() < 3 || (mode == Mode::Triangles && !indices.len().is_multiple_of(3)) {
            self.raw.left_out.push(place);
        }
        for (triangle, local) in Triangles::new(&indices, mode).zip(0..) {
            let place = within(place, local);
            for index in triangle {
                if index as usize >= count {
                    let fault = Fault::IndexOutOfRange { index: index.into(), vertices: count };
                    return Err(Failure::at(place, fault));
                }
            }
            let [a, b, c] = triangle.map(|index| first + index);
            // A mirroring transform turns faces inside out; glTF asks to turn them back.
            let turned = if placed.mirrors() { [a, c, b] } else { [a, b, c] };
            self.raw.triangle(turned, place)?;
        }
        Ok(())
    }
}

/// As many bytes of the name of a node are kept. Objects with longer names are told apart by a number.
const LONGEST_NAME: usize = 256;

fn is_surface(mode: Mode) -> bool {
    matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
}

/// Triples of a list, strip or fan, in the order and winding that glTF gives them.
struct Triangles<'a> {
    indices: &'a [u32],
    mode: Mode,
    next: usize,
}

impl<'a> Triangles<'a> {
    fn new(indices: &'a [u32], mode: Mode) -> Self {
        Self { indices, mode, next: 0 }
    }
}

impl Iterator for Triangles<'_> {
    type Item = [u32; 3];

    fn next(&mut self) -> Option<[u32; 3]> {
        let i = self.next;
        self.next += 1;
        let corners = match self.mode {
            Mode::TriangleStrip => strip_corners(i),
            Mode::TriangleFan => [i + 1, i + 2, 0],
            _ => [3 * i, 3 * i + 1, 3 * i + 2],
        };
        let [a, b, c] = corners.map(|corner| self.indices.get(corner).copied());
        Some([a?, b?, c?])
    }
}

fn within(place: Place, triangle: u32) -> Place {
    match place {
        Place::Primitive { mesh, primitive } => Place::Triangle { mesh, primitive, triangle },
        other => other,
    }
}

#[cfg(test)]
mod tests;
