//! A file that was read and is no mesh yet: all that it holds becomes one, or each of its objects does.
//!
//! Objects are what the file calls so: the `o` lines of an OBJ file (where it has none, the groups of its `g` lines), the solids of
//! an STL file, the nodes with a mesh of a glTF file. Each is called by the name that it has there, made fit for a folder.

//!
//! ```no_run
//! let ingested = chladni::mesh::load("bunny.obj".as_ref())?;
//! println!("{} vertices, {}", ingested.mesh.n(), ingested.mesh.hash());
//! # Ok::<(), chladni::mesh::MeshError>(())
//! ```

use std::collections::{HashMap, HashSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::error::{Failure, Fault, MeshError};
use super::ingest::Ingested;
use super::raw::RawMesh;
use super::read::format::Format;
use super::read::{gltf, obj, off, ply, stl, vtk, vtp};

/// Reads the file at `path`, all of it as one mesh. [`Opened`] tells its objects apart.
///
/// # Errors
/// When the file cannot be read, is no mesh, or has nothing that repair can keep: see [`Fault`].
pub fn load(path: &Path) -> Result<Ingested, MeshError> {
    Opened::read(path)?.whole()
}

/// Reads a file whose content is already here. `path` names it in messages, gives its extension, and says
/// where the buffers of a `.gltf` are looked for.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(path: &Path, bytes: &[u8]) -> Result<Ingested, MeshError> {
    Opened::of_bytes(path, bytes)?.whole()
}

/// The content of a file.
#[derive(Debug, Clone)]
pub struct Opened {
    path: PathBuf,
    format: Format,
    raw: RawMesh,
    /// The objects with triangles: their numbers in `raw` and their names.
    named: OnceLock<Vec<(usize, String)>>,
}

/// The longest name of an object, in bytes: a folder's may have 255.
const LONGEST: usize = 120;

impl Opened {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// When it cannot be read or is no mesh file.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        // A pipe or a device would be read for ever.
        let regular = || match path.metadata() {
            Ok(metadata) if metadata.is_dir() => {
                Err(io::Error::other("it is a folder; name a file that is in it"))
            }
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

    /// Reads a file whose content is already here: see [`load_bytes`].
    ///
    /// # Errors
    /// When it is no mesh file.
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Result<Self, MeshError> {
        let parsed = parse(path, bytes).map_err(|failure| failure.in_file(path))?;
        let (format, raw) = parsed;
        Ok(Self { path: path.into(), format, raw, named: OnceLock::new() })
    }

    /// The names of its objects that have triangles, each another one; none where the file does not tell of objects.
    pub fn objects(&self) -> Vec<String> {
        self.named().iter().map(|(_, name)| name.clone()).collect()
    }

    /// All of it as one mesh.
    ///
    /// # Errors
    /// When nothing is left of it that has an area, or a position is not finite.
    pub fn whole(&self) -> Result<Ingested, MeshError> {
        Ingested::of(&self.raw, self.format, None).map_err(|failure| failure.in_file(&self.path))
    }

    /// One object as a mesh.
    ///
    /// # Errors
    /// As [`Self::whole`], of the object; and when there is none of that name.
    pub fn object(&self, name: &str) -> Result<Ingested, MeshError> {
        let Some((object, _)) = self.named().iter().find(|(_, known)| known == name) else {
            let fault = Fault::NoObject { name: name.into(), objects: self.objects() };
            return Err(Failure::from(fault).in_file(&self.path));
        };
        let part = self.raw.only(*object).map_err(Failure::from);
        part.and_then(|(raw, of_file)| Ingested::of(&raw, self.format, Some(of_file)))
            .map_err(|failure| failure.in_file(&self.path.join(name)))
    }

    /// The name here of an object that the file calls so; of several the first.
    pub fn called(&self, name: &str) -> Option<&str> {
        let in_file = self.raw.objects();
        let place = in_file.iter().position(|(_, known)| *known == Some(name))?;
        Some(&self.named().get(place)?.1)
    }

    fn named(&self) -> &[(usize, String)] {
        self.named.get_or_init(|| {
            let objects = self.raw.objects();
            let mut names = Names::default();
            let named = objects.into_iter().zip(1..).map(|((object, name), place)| {
                let plain = name.and_then(fit_for_a_folder).unwrap_or(format!("object-{place}"));
                (object, names.another(plain))
            });
            named.collect()
        })
    }
}

/// Names of which each is another one, to folders that do not tell capitals apart too.
#[derive(Default)]
struct Names {
    taken: HashSet<String>,
    /// How often a name was asked for.
    asked: HashMap<String, usize>,
}

impl Names {
    /// This one, or where it is taken the same with the next number.
    fn another(&mut self, plain: String) -> String {
        let asked = self.asked.entry(plain.to_lowercase()).or_default();
        loop {
            *asked += 1;
            let name = if *asked == 1 { plain.clone() } else { format!("{plain}-{asked}") };
            if self.taken.insert(name.to_lowercase()) {
                return name;
            }
        }
    }
}

fn parse(path: &Path, bytes: &[u8]) -> Result<(Format, RawMesh), Failure> {
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
    Ok((format, raw))
}

/// A name as that of a folder, which no file of results has: what is neither letter, digit, `-` nor `_` becomes `_`.
fn fit_for_a_folder(name: &str) -> Option<String> {
    let fit = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let mut fitting: String = name.trim().chars().map(fit).collect();
    fitting.truncate(fitting.floor_char_boundary(LONGEST));
    fitting.contains(|c| c != '_').then_some(fitting)
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
        assert_eq!(right.file_vertices.as_deref(), Some(&[1, 2, 3][..]));
        assert_eq!(right.vertex_map, [0, 1, 2]);
        assert_eq!((right.mesh.n(), right.repairs.unreferenced_vertices.count), (3, 0));
        assert_eq!((right.repairs.left_out.count, right.format), (1, Format::Obj));
        assert!(file.object("left").unwrap().repairs.is_empty());
        assert_eq!(file.whole().unwrap().mesh.faces().len(), 2);
        assert_eq!((file.called("right wing"), file.called("tail")), (Some("right_wing"), None));
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
        let names = |given: &[&str]| {
            let mut names = Names::default();
            given.iter().map(|name| names.another(name.to_string())).collect::<Vec<_>>()
        };
        assert_eq!(names(&["a", "a-2", "A", "a"]), ["a", "a-2", "A-3", "a-4"]);
        let long = fit_for_a_folder(&"ä".repeat(200)).unwrap();
        assert_eq!(long.chars().count(), LONGEST / 2);
        assert_eq!(fit_for_a_folder("wheel.001").unwrap(), "wheel_001");
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
        assert_eq!(file.object("object-2").unwrap().file_vertices, Some(vec![3, 4, 5]));
    }
}
