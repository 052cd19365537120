//! What the network reads at every vertex.

use std::borrow::Cow;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::landmarks::Landmarks;
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{norm, sub};
use crate::operators::Pattern;

/// What the network reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FeatureOptions {
    /// What it reads at every vertex. The last two do not depend on how a mesh lies in space.
    pub input: Input,
    /// How that is scaled. ["paper": "none"]
    pub normalise: Normalise,
    /// How many landmarks.
    pub landmarks: usize,
}

/// `features.input`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Input {
    /// x, y, z, as in (28).
    #[default]
    Coordinates,
    /// The shortest, the mean and the longest of the edges that meet there: the paper's Fig. 9 in three numbers, which hardly tell
    /// vertices apart.
    EdgeLengths,
    /// Geodesic distances from a few points of the shape, which are found again on every mesh of it.
    Landmarks,
}

/// How features are prepared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Normalise {
    /// Nothing depends on units: coordinates are centred at the surface's centroid and scaled to unit area, distances are in units of
    /// √area, edge lengths in units of √(area / vertices).
    #[default]
    Area,
    /// As they are in the file.
    None,
}

/// Coordinates are three input features d of a vertex.
pub const COORDINATES: usize = 3;

/// Of the lengths of its edges a vertex has three, too.
const EDGE_LENGTHS: usize = 3;

impl Default for FeatureOptions {
    fn default() -> Self {
        Self { input: Input::Coordinates, normalise: Normalise::Area, landmarks: 16 }
    }
}

impl FeatureOptions {
    /// These options, with the defaults for those that the input does not use: what the features depend on.
    pub fn effective(self) -> Self {
        match self.input {
            Input::Landmarks => self,
            Input::Coordinates | Input::EdgeLengths => {
                Self { landmarks: Self::default().landmarks, ..self }
            }
        }
    }

    /// d: features per vertex.
    pub fn inputs(&self) -> usize {
        match self.input {
            Input::Coordinates => COORDINATES,
            Input::EdgeLengths => EDGE_LENGTHS,
            Input::Landmarks => self.landmarks,
        }
    }
}

/// What a model reads of every mesh, its own shape's landmarks among it: part of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Features {
    /// Coordinates in the frame of the training mesh, or as they are in the file.
    Coordinates(Option<Frame>),
    /// [`edge_lengths`].
    EdgeLengths(Normalise),
    /// [`landmark_distances`].
    Landmarks(Normalise, Landmarks),
}

impl Features {
    /// What the model of the shape `mesh` reads.
    pub fn of(mesh: &TriMesh, options: FeatureOptions) -> Self {
        let FeatureOptions { input, normalise, landmarks } = options;
        match input {
            Input::Coordinates => Self::Coordinates(match normalise {
                Normalise::Area => Some(Frame::of(mesh)),
                Normalise::None => None,
            }),
            Input::EdgeLengths => Self::EdgeLengths(normalise),
            Input::Landmarks => Self::Landmarks(normalise, Landmarks::of(mesh, landmarks)),
        }
    }

    /// d: features per vertex; `None` when what is known of the landmarks contradicts itself.
    pub fn inputs(&self) -> Option<usize> {
        match self {
            Self::Coordinates(_) => Some(COORDINATES),
            Self::EdgeLengths(_) => Some(EDGE_LENGTHS),
            Self::Landmarks(_, landmarks) => landmarks.is_sound().then_some(landmarks.count()),
        }
    }

    /// How the coordinates are prepared, where they are what is read.
    pub fn placed(&self) -> Option<Normalise> {
        match self {
            Self::Coordinates(Some(_)) => Some(Normalise::Area),
            Self::Coordinates(None) => Some(Normalise::None),
            Self::EdgeLengths(_) | Self::Landmarks(..) => None,
        }
    }

    /// The features of every vertex of a mesh of that shape, which may lie elsewhere or be in other units than the training
    /// mesh: it is then read in its own frame. Row-major n×d.
    pub fn read_anywhere(&self, mesh: &TriMesh) -> Vec<f64> {
        self.near(mesh).read(mesh)
    }

    /// What is read of a mesh of that shape, and of its samplings, where it lies: in its own frame, if it was moved or is in
    /// other units.
    pub fn near(&self, mesh: &TriMesh) -> Cow<'_, Self> {
        match self {
            Self::Coordinates(Some(frame)) => Cow::Owned(Self::Coordinates(Some(frame.near(mesh)))),
            _ => Cow::Borrowed(self),
        }
    }

    /// The features of every vertex of a sampling of that shape where the training mesh lies, row-major n×d.
    pub fn read(&self, mesh: &TriMesh) -> Vec<f64> {
        match self {
            Self::Coordinates(Some(frame)) => frame.coordinates(mesh),
            Self::Coordinates(None) => coordinates(mesh, Normalise::None),
            Self::EdgeLengths(normalise) => edge_lengths(mesh, *normalise),
            Self::Landmarks(normalise, landmarks) => {
                landmark_distances(mesh, landmarks, *normalise)
            }
        }
    }
}

/// Where a surface lies, and how large it is.
///
/// All samplings of a shape must be read in one frame. Each in its own, of which area and centroid differ a little from
/// one to the next, a network tells them apart by where they lie: an eigenfunction with one sign on some members and the
/// other on the rest is then orthogonal to itself, and training finds it several times (`docs/training.md`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// The centroid, input units.
    pub centre: [f64; 3],
    /// √area, input units.
    pub unit: f64,
}

/// Frames this close are those of two samplings in one place and one unit; farther apart a mesh was moved or scaled.
const SAME_PLACE: f64 = 0.05;

impl Frame {
    /// The frame of a surface.
    pub fn of(mesh: &TriMesh) -> Self {
        let areas = mesh.vertex_areas();
        let area: f64 = areas.iter().sum();
        let mut centre = [0.0; 3];
        for (point, weight) in mesh.vertices().iter().zip(&areas) {
            (0..3).for_each(|c| centre[c] += weight / area * point[c]);
        }
        Self { centre, unit: area.sqrt() }
    }

    /// This frame, if `mesh` lies there; its own if it was moved or is in other units.
    pub fn near(self, mesh: &TriMesh) -> Self {
        let own = Self::of(mesh);
        let way = norm(sub(own.centre, self.centre)) / self.unit;
        let same = way <= SAME_PLACE && (own.unit / self.unit).ln().abs() <= SAME_PLACE;
        if same { self } else { own }
    }

    /// The coordinates of every vertex from the centroid in units of √area, row-major n×3.
    pub fn coordinates(self, mesh: &TriMesh) -> Vec<f64> {
        let Self { centre, unit } = self;
        let place = |point: &[f64; 3]| -> [f64; 3] {
            std::array::from_fn(|c| (point[c] - centre[c]) / unit)
        };
        mesh.vertices().iter().flat_map(place).collect()
    }
}

/// The coordinates of every vertex, row-major n×3, prepared as asked, in the mesh's own frame.
pub fn coordinates(mesh: &TriMesh, normalise: Normalise) -> Vec<f64> {
    match normalise {
        Normalise::None => mesh.vertices().iter().flatten().copied().collect(),
        Normalise::Area => Frame::of(mesh).coordinates(mesh),
    }
}

/// The shortest, the mean and the longest edge of every vertex, row-major n×3; in units of √(area/n), the spacing of n
/// vertices on the surface, or as they are.
pub fn edge_lengths(mesh: &TriMesh, normalise: Normalise) -> Vec<f64> {
    let unit = match normalise {
        Normalise::Area => (mesh.area().0 / mesh.n() as f64).sqrt(),
        Normalise::None => 1.0,
    };
    let pattern = Pattern::of_mesh(mesh);
    let place = |vertex: usize| mesh.vertices()[vertex];
    (0..mesh.n())
        .flat_map(|vertex| {
            let neighbours = pattern.row(vertex).iter().map(|&j| j as usize);
            let lengths = neighbours
                .filter(|&j| j != vertex)
                .map(|j| norm(sub(place(j), place(vertex))) / unit);
            let shortest = lengths.clone().fold(f64::INFINITY, f64::min);
            let longest = lengths.clone().fold(0.0, f64::max);
            let (sum, count) = lengths.fold((0.0, 0.0), |(sum, count), l| (sum + l, count + 1.0));
            [shortest, sum / count, longest]
        })
        .collect()
}

/// The distances of every vertex from m landmarks, row-major n×m, in units of √area or as they are, times √(2/m): like
/// the coordinates, all together then change by √2 for every unit of way, whatever m, so that a range of encoder
/// weights stands for the same frequencies.
pub fn landmark_distances(mesh: &TriMesh, landmarks: &Landmarks, normalise: Normalise) -> Vec<f64> {
    let unit = match normalise {
        Normalise::Area => 1.0,
        Normalise::None => mesh.area().0.sqrt(),
    };
    let scale = unit * (2.0 / landmarks.count() as f64).sqrt();
    landmarks.distances_on(mesh).into_iter().map(|d| scale * d).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    /// The same mesh turned about (1, 1, 1), 250 times as large and elsewhere.
    fn moved(mesh: &TriMesh) -> TriMesh {
        let place = |&[x, y, z]: &[f64; 3]| [z, x, y].map(|c| 250.0 * c + 31.0);
        let vertices = mesh.vertices().iter().map(place).collect();
        TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
    }

    fn spot() -> TriMesh {
        crate::mesh::load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh
    }

    fn options(input: Input) -> FeatureOptions {
        FeatureOptions { input, ..FeatureOptions::default() }
    }

    fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn normalised_coordinates_do_not_depend_on_place_or_units() {
        let mesh = icosphere(1);
        let moved = mesh.vertices().iter().map(|p| p.map(|c| 250.0 * c + 31.0)).collect();
        let moved = TriMesh::new(moved, mesh.faces().to_vec()).unwrap();
        let (a, b) = (coordinates(&mesh, Normalise::Area), coordinates(&moved, Normalise::Area));
        assert!(largest_difference(&a, &b) < 1e-12);
        assert_ne!(coordinates(&mesh, Normalise::None), coordinates(&moved, Normalise::None));
    }

    #[test]
    fn samplings_in_one_place_are_read_in_one_frame_and_moved_ones_in_their_own() {
        let (coarse, fine) = (icosphere(2), icosphere(4));
        let features = Features::of(&coarse, FeatureOptions::default());
        // The coarse polyhedron has less area: in its own frame every sphere would have another radius.
        assert_eq!(features.read_anywhere(&fine), features.read(&fine));
        let radius = |x: &[f64]| norm([x[0], x[1], x[2]]);
        let (a, b) = (features.read(&coarse), features.read(&fine));
        assert!((radius(&a) - radius(&b)).abs() < 1e-12);
        let read = features.read_anywhere(&moved(&fine));
        assert!((radius(&read) / radius(&b) - 1.0).abs() < 0.02);
    }

    #[test]
    fn edge_lengths_and_landmarks_do_not_depend_on_the_pose_either() {
        let (mesh, other) = (spot(), moved(&spot()));
        for input in [Input::EdgeLengths, Input::Landmarks] {
            let features = Features::of(&mesh, options(input));
            assert!(largest_difference(&features.read(&mesh), &features.read(&other)) < 1e-10);
            let units = FeatureOptions { normalise: Normalise::None, ..options(input) };
            let features = Features::of(&mesh, units);
            let larger: Vec<f64> = features.read(&mesh).iter().map(|x| 250.0 * x).collect();
            assert!(largest_difference(&larger, &features.read(&other)) < 1e-8);
        }
    }

    #[test]
    fn every_input_has_the_features_that_its_options_say() {
        let mesh = icosphere(1);
        for input in [Input::Coordinates, Input::EdgeLengths, Input::Landmarks] {
            let features = Features::of(&mesh, options(input));
            assert_eq!(features.inputs(), Some(options(input).inputs()));
            assert_eq!(features.read(&mesh).len(), mesh.n() * options(input).inputs());
        }
    }

    #[test]
    fn edge_lengths_are_those_of_the_icosahedron_and_keep_their_size_when_it_is_subdivided() {
        let mesh = icosphere(0);
        let edge = norm(sub(mesh.vertices()[0], mesh.vertices()[11]));
        let lengths = edge_lengths(&mesh, Normalise::None);
        assert!(lengths.iter().all(|l| (l - edge).abs() < 1e-15));
        let mean = |mesh: &TriMesh| {
            edge_lengths(mesh, Normalise::Area).iter().sum::<f64>() / (3 * mesh.n()) as f64
        };
        assert!((mean(&icosphere(2)) / mean(&icosphere(4)) - 1.0).abs() < 0.01);
    }
}
