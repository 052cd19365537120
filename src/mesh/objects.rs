//! A file that was read and is no mesh yet: all that it holds becomes one, or each of its objects does.
//!
//! Objects are what the file calls so: the `o` lines of an OBJ file (where it has none, the groups of its `g` lines), the solids of
//! an STL file, the nodes with a mesh of a glTF file. Each is called by the name that it has there, made fit for a folder.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

use super::error::{Failure, Fault, MeshError};
use super::ingest::Ingested;
use super::raw::RawMesh;
use super::read::format::Format;
use super::read::{gltf, obj, off, ply, stl, vtk, vtp};
use super::repair::{Repaired, repair};
use super::topology::Topology;

/// The content of a file.
#[derive(Debug, Clone)]
pub struct Opened {
    path: PathBuf,
    format: Format,
    raw: RawMesh,
}

/// The longest name of an object, in characters.
const LONGEST: usize = 80;

impl Opened {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// When it cannot be read or is no mesh file.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        // A pipe or a device would be read for ever.
        let regular = || match path.metadata() {
            Ok(metadata) if !metadata.is_file() => {
                Err(io::Error::other("it is not a regular file"))
            }
            _ => Ok(()),
        };
        let bytes = regular()
            .and_then(|()| std::fs::read(path))
            .map_err(|error| Failure::from(Fault::Unreadable(error)).in_file(path))?;
        Self::of_bytes(path, &bytes)
    }

    /// Reads a file whose content is already here: see [`load_bytes`](super::load_bytes).
    ///
    /// # Errors
    /// When it is no mesh file.
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self, MeshError> {
        parse(path, bytes).map_err(|failure| failure.in_file(path))
    }

    /// The names of its objects that have triangles, each another one; none where the file does not tell of objects.
    pub fn objects(&self) -> Vec<String> {
        self.named().into_iter().map(|(_, name)| name).collect()
    }

    /// All of it as one mesh.
    ///
    /// # Errors
    /// When nothing is left of it that has an area, or a position is not finite.
    pub fn whole(&self) -> Result<Ingested, MeshError> {
        self.mended(&self.raw, None).map_err(|failure| failure.in_file(&self.path))
    }

    /// One object as a mesh. The vertices of the others have −1 in [`Ingested::vertex_map`].
    ///
    /// # Errors
    /// As [`Self::whole`], of the object; and when there is none of that name.
    pub fn object(&self, name: &str) -> Result<Ingested, MeshError> {
        self.part(name).map_err(|failure| failure.in_file(&self.path))
    }

    fn part(&self, name: &str) -> Result<Ingested, Failure> {
        let named = self.named();
        let Some((object, _)) = named.iter().find(|(_, known)| known == name) else {
            return Err(Fault::NoObject { name: name.into(), objects: self.objects() }.into());
        };
        let (raw, of_file) = self.raw.only(*object)?;
        self.mended(&raw, Some(&of_file))
    }

    /// The mesh of all or a part, whose positions have these indices in the file.
    fn mended(&self, raw: &RawMesh, of_file: Option<&[u32]>) -> Result<Ingested, Failure> {
        let Repaired { mesh, vertex_map: rows, repairs } = repair(raw)?;
        let vertex_map = match of_file {
            None => rows,
            Some(of_file) => {
                let mut map = vec![-1; self.raw.positions.len()];
                for (&index, row) in of_file.iter().zip(rows) {
                    map[index as usize] = row;
                }
                map
            }
        };
        tracing::debug!(
            path = %self.path.display(),
            vertices = mesh.n(),
            faces = mesh.faces().len(),
            mended = !repairs.is_empty(),
            "mesh read"
        );
        let topology = Topology::of(&mesh);
        Ok(Ingested { mesh, vertex_map, repairs, topology, format: self.format })
    }

    /// The objects with triangles, by their numbers in `raw`.
    fn named(&self) -> Vec<(usize, String)> {
        let mut taken = HashSet::new();
        let objects = self.raw.objects().into_iter().zip(1..);
        let named = objects.map(|((object, name), place)| {
            let plain = name.and_then(fit_for_a_folder).unwrap_or(format!("object-{place}"));
            let numbered = (2..).map(|number: usize| format!("{plain}-{number}"));
            // Folders may not tell capitals apart.
            let is_free = |name: &String| taken.insert(name.to_lowercase());
            let name = std::iter::once(plain.clone()).chain(numbered).find(is_free);
            (object, name.unwrap_or(plain.clone()))
        });
        named.collect()
    }
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Opened, Failure> {
    let format = Format::of(bytes, path.extension().and_then(|e| e.to_str()))?;
    let raw = match format {
        Format::Obj => obj::read(bytes)?,
        Format::Off => off::read(bytes)?,
        Format::Ply => ply::read(bytes)?,
        Format::Stl => stl::read(bytes)?,
        Format::Vtk => vtk::read(bytes)?,
        Format::Vtp => vtp::read(bytes)?,
        Format::Gltf | Format::Glb => gltf::read(bytes, path)?,
    };
    Ok(Opened { path: path.into(), format, raw })
}

/// A name as that of a folder: what is neither letter, digit nor one of `-_.` becomes `_`.
fn fit_for_a_folder(name: &str) -> Option<String> {
    let fit = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = name.trim().chars().map(fit).take(LONGEST).collect();
    // Hidden files are no results.
    let name = name.trim_matches('.');
    (!name.is_empty()).then(|| name.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(name: &str, text: &str) -> Opened {
        Opened::of_bytes(name.as_ref(), text.as_bytes()).unwrap()
    }

    const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 5 5 5\n";

    #[test]
    fn objects_are_meshes_of_their_own_with_their_way_back_to_the_file() {
        let text = format!("{CORNERS}g seam\no left\nf 1 2 3\no right wing\nf 2 3 4\np 5\ng lid\n");
        let file = open("a.obj", &text);
        assert_eq!(file.objects(), ["left", "right_wing"]);
        let right = file.object("right_wing").unwrap();
        assert_eq!(right.vertex_map, [-1, 0, 1, 2, -1]);
        assert_eq!((right.mesh.n(), right.repairs.unreferenced_vertices.count), (3, 0));
        assert_eq!((right.repairs.left_out.count, right.format), (1, Format::Obj));
        assert!(file.object("left").unwrap().repairs.is_empty());
        assert_eq!(file.whole().unwrap().mesh.faces().len(), 2);
        let error = file.object("tail").unwrap_err().to_string();
        assert!(error.ends_with("it has left, right_wing"), "{error}");
    }

    #[test]
    fn groups_are_objects_where_nothing_else_is_and_names_are_unique() {
        let text =
            "f 1 2 3\ng A/b\nf 2 3 4\ng a_b\nf 1 3 4\ng ..\nf 1 2 4\ng A/b\nf 3 2 1\ng\nf 4 3 2\n";
        let file = open("a.obj", &format!("{CORNERS}{text}"));
        assert_eq!(file.objects(), ["object-1", "A_b", "a_b-2", "object-4", "object-5"]);
        assert_eq!(file.object("A_b").unwrap().mesh.faces().len(), 2);
        assert_eq!(open("b.obj", &format!("{CORNERS}f 1 2 3\n")).objects(), [""; 0]);
    }

    #[test]
    fn solids_of_a_text_file_are_objects() {
        let facet = "facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
        let text = format!(
            "solid left lid\n{facet}endsolid\nsolid\n{facet}endsolid x\nsolid c\nendsolid\n"
        );
        let file = open("a.stl", &text);
        assert_eq!(file.objects(), ["left_lid", "object-2"]);
        assert_eq!(file.object("object-2").unwrap().vertex_map, [-1, -1, -1, 0, 1, 2]);
    }
}
