//! Landmarks: a few points of a shape, found again on any other mesh of it, and the geodesic distances from them.
//!
//! A model knows its landmarks by their distances to one another alone, so that neither the place nor the pose of a mesh
//! matters, nor how its vertices are numbered. On another mesh they are looked for in three steps:
//! 1. candidates: the farthest-point sample of that mesh, each the farthest from those before it;
//! 2. openings: the choices of candidates whose distances to one another come closest to those of the first landmarks;
//! 3. each of the best openings is completed landmark by landmark with the point whose distances to those already placed
//!    fit best; then, for the opening that fits best as a whole, every landmark is moved to where it fits best
//!    among all others, until none moves.
//!
//! On a symmetric shape what is found may be the image under a symmetry, of all landmarks together: the distances,
//! and the eigenfunctions, are carried along. Nothing is assembled or solved.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::mesh::TriMesh;
use crate::mesh::closest::{ClosestPoint, SurfacePoint};
use crate::mesh::geodesic::Geodesics;
use crate::mesh::trimesh::{norm, sub};
use crate::remesh::simplify::simplify;

/// The landmarks of a shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Landmarks {
    /// Their number m.
    count: usize,
    /// Their distances to one another, row-major m×m, in units of √area.
    distances: Vec<f64>,
}

/// How far another piece of the shape is said to be, in units of √area.
const ELSEWHERE: f64 = 4.0;

/// Candidates on another mesh.
const CANDIDATES: usize = 16;

/// Landmarks that an opening places.
const OPENING: usize = 4;

/// Openings that are completed.
const COMPLETED: usize = 4;

/// How often all landmarks of each are moved at most before one is chosen.
const FIRST_ROUNDS: usize = 2;

/// How often those of the chosen one are moved at most.
const ROUNDS: usize = 6;

/// A mesh of more than twice as many vertices is simplified to so many for the search; then the landmarks are moved on
/// the mesh itself.
const COARSE: usize = 1_500;

/// Points of a triangle that are tried lie at multiples of one over this in barycentric coordinates.
const CUTS: usize = 8;

impl Landmarks {
    /// Takes the `count` first of the farthest-point sample of `mesh`; from then on they are the model's.
    pub fn of(mesh: &TriMesh, count: usize) -> Self {
        let places = farthest_points(&Surface::of(mesh), count);
        let distances =
            places.iter().flat_map(|from| places.iter().map(|to| from.at(&to.point))).collect();
        Self { count, distances }
    }

    /// Their number, m.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether there is a distance for every two of them, and at least one landmark.
    pub fn is_sound(&self) -> bool {
        self.count > 0 && self.count.checked_mul(self.count) == Some(self.distances.len())
    }

    /// The distance of every vertex of `mesh` from every landmark, row-major n×m, in units of √area.
    pub fn distances_on(&self, mesh: &TriMesh) -> Vec<f64> {
        let places = self.find(&Surface::of(mesh));
        (0..mesh.n()).flat_map(|vertex| places.iter().map(move |p| p.distances[vertex])).collect()
    }

    fn find(&self, surface: &Surface<'_>) -> Vec<Place> {
        match self.find_on_coarser(surface.mesh) {
            Some(positions) => {
                let closest = ClosestPoint::on(surface.mesh);
                let places = positions.into_iter().map(|position| {
                    let SurfacePoint { face, weights, .. } = closest.to(position);
                    surface.place(Point { corners: surface.mesh.faces()[face], weights })
                });
                self.moved(surface, places.collect(), ROUNDS)
            }
            None => self.search(surface),
        }
    }

    /// Where the landmarks lie on a simplification of a mesh of many vertices; none where the mesh has few.
    fn find_on_coarser(&self, mesh: &TriMesh) -> Option<Vec<[f64; 3]>> {
        if mesh.n() <= 2 * COARSE {
            return None;
        }
        // Nothing is jittered, so nothing depends on the seed.
        let coarser = simplify(mesh, COARSE, 0.0, &mut ChaCha8Rng::seed_from_u64(0)).ok()?;
        let surface = Surface::of(&coarser);
        let positions = self.search(&surface).into_iter().map(|p| surface.position(&p.point));
        Some(positions.collect())
    }

    fn search(&self, surface: &Surface<'_>) -> Vec<Place> {
        let candidates = farthest_points(surface, CANDIDATES.max(self.count.min(OPENING)));
        let started: Vec<Vec<Place>> = self
            .openings(&candidates)
            .into_par_iter()
            .map(|opening| {
                let mut places = vec![None; self.count];
                for (place, candidate) in places.iter_mut().zip(opening) {
                    *place = Some(candidates[candidate].clone());
                }
                self.moved(surface, self.completed(surface, places), FIRST_ROUNDS)
            })
            .collect();
        let fitting = started.into_iter().min_by(|a, b| self.misfit(a).total_cmp(&self.misfit(b)));
        self.settled(surface, fitting.unwrap_or_default())
    }

    /// Moves all landmarks until they fit; then takes the quarter that fits worst away and places it anew, all at once:
    /// landmarks on the wrong side of a nearly symmetric shape hold one another there.
    fn settled(&self, surface: &Surface<'_>, places: Vec<Place>) -> Vec<Place> {
        let places = self.moved(surface, places, ROUNDS);
        let numbers = 0..places.len();
        let misfit = |i: usize| numbers.clone().map(|j| self.miss(&places, i, j)).sum::<f64>();
        let mut worst: Vec<(f64, usize)> = numbers.clone().map(|i| (misfit(i), i)).collect();
        worst.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut fewer: Vec<Option<Place>> = places.iter().cloned().map(Some).collect();
        worst[..places.len() / 4].iter().for_each(|&(_, landmark)| fewer[landmark] = None);
        let others = self.moved(surface, self.completed(surface, fewer), ROUNDS);
        if self.misfit(&others) < self.misfit(&places) { others } else { places }
    }

    /// Gives every landmark without a place the one that fits best among those that have one.
    fn completed(&self, surface: &Surface<'_>, mut places: Vec<Option<Place>>) -> Vec<Place> {
        for landmark in 0..places.len() {
            if places[landmark].is_none() {
                let others = places.iter().enumerate().filter_map(|(i, p)| Some((i, p.as_ref()?)));
                let point = self.best_point(surface, landmark, others);
                places[landmark] = Some(surface.place(point));
            }
        }
        places.into_iter().flatten().collect()
    }

    /// Moves every landmark to where it fits best among the others, until none moves, at most `rounds` times.
    fn moved(&self, surface: &Surface<'_>, mut places: Vec<Place>, rounds: usize) -> Vec<Place> {
        for _ in 0..rounds {
            if !self.move_each(surface, &mut places) {
                break;
            }
        }
        places
    }

    /// The best choices of candidates for the first landmarks, the best first.
    fn openings(&self, candidates: &[Place]) -> Vec<Vec<usize>> {
        let mut best: Vec<(f64, Vec<usize>)> = Vec::new();
        self.extend_opening(candidates, &mut Vec::new(), 0.0, &mut best);
        best.into_iter().map(|(_, opening)| opening).collect()
    }

    /// Tries every candidate in the next place of an opening, unless the misfit is too large already.
    fn extend_opening(
        &self,
        candidates: &[Place],
        opening: &mut Vec<usize>,
        misfit: f64,
        best: &mut Vec<(f64, Vec<usize>)>,
    ) {
        if best.len() == COMPLETED && misfit >= best[COMPLETED - 1].0 {
            return;
        }
        if opening.len() == self.count.min(OPENING) {
            let at = best.partition_point(|(other, _)| *other <= misfit);
            best.insert(at, (misfit, opening.clone()));
            best.truncate(COMPLETED);
            return;
        }
        let next = opening.len();
        for candidate in 0..candidates.len() {
            if opening.contains(&candidate) {
                continue;
            }
            let added: f64 = opening
                .iter()
                .enumerate()
                .map(|(i, &other)| {
                    let found = candidates[other].at(&candidates[candidate].point);
                    (found - self.distance(i, next)).powi(2)
                })
                .sum();
            opening.push(candidate);
            self.extend_opening(candidates, opening, misfit + added, best);
            opening.pop();
        }
    }

    /// Moves every landmark to where it fits best among the others; whether any moved.
    fn move_each(&self, surface: &Surface<'_>, places: &mut [Place]) -> bool {
        let mut moved = false;
        for landmark in 0..places.len() {
            let others = places.iter().enumerate().filter(|&(i, _)| i != landmark);
            let point = self.best_point(surface, landmark, others);
            if point != places[landmark].point {
                places[landmark] = surface.place(point);
                moved = true;
            }
        }
        moved
    }

    /// The point whose distances from the `others`, given with their numbers, are nearest to what `landmark` has:
    /// first of all vertices, then within the triangles around that vertex.
    fn best_point<'p>(
        &self,
        surface: &Surface<'_>,
        landmark: usize,
        others: impl Iterator<Item = (usize, &'p Place)> + Clone,
    ) -> Point {
        let misfit = |distance: &dyn Fn(&Place) -> f64| -> f64 {
            let misses = others.clone().map(|(i, p)| distance(p) - self.distance(i, landmark));
            misses.map(|miss| miss * miss).sum()
        };
        let vertices = 0..surface.mesh.n();
        let vertex = lowest(vertices, |&vertex| misfit(&|p: &Place| p.distances[vertex]));
        let points = surface.points_around(vertex.unwrap_or(0));
        let point = lowest(points, |point| misfit(&|p: &Place| p.at(point)));
        point.unwrap_or_else(|| surface.vertex(0))
    }

    /// The squared errors of all distances between the landmarks.
    fn misfit(&self, places: &[Place]) -> f64 {
        let pairs = (0..places.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs.map(|(i, j)| self.miss(places, i, j)).sum()
    }

    /// The squared error of one distance.
    fn miss(&self, places: &[Place], from: usize, to: usize) -> f64 {
        (places[from].at(&places[to].point) - self.distance(from, to)).powi(2)
    }

    fn distance(&self, from: usize, to: usize) -> f64 {
        self.distances[from * self.count + to]
    }
}

/// The first of the items with the lowest value.
fn lowest<T>(items: impl IntoIterator<Item = T>, value: impl Fn(&T) -> f64) -> Option<T> {
    items
        .into_iter()
        .map(|item| (value(&item), item))
        .reduce(|a, b| if b.0 < a.0 { b } else { a })
        .map(|best| best.1)
}

/// A point of a mesh: the corners of a triangle, and how much of each.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Point {
    corners: [u32; 3],
    weights: [f64; 3],
}

/// A point with the distance of every vertex from it, in units of √area.
#[derive(Debug, Clone)]
struct Place {
    point: Point,
    distances: Vec<f64>,
}

impl Place {
    /// The distance of a point from here.
    fn at(&self, to: &Point) -> f64 {
        let corners = to.corners.iter().zip(to.weights);
        corners.map(|(&corner, weight)| weight * self.distances[corner as usize]).sum()
    }
}

/// A mesh with what the search needs of it.
struct Surface<'m> {
    mesh: &'m TriMesh,
    geodesics: Geodesics<'m>,
    /// √area.
    unit: f64,
}

impl<'m> Surface<'m> {
    fn of(mesh: &'m TriMesh) -> Self {
        Self { mesh, geodesics: Geodesics::on(mesh), unit: mesh.area().0.sqrt() }
    }

    fn place(&self, point: Point) -> Place {
        let (positions, position) = (self.mesh.corners(point.corners), self.position(&point));
        let known =
            [0, 1, 2].map(|i| (point.corners[i] as usize, norm(sub(positions[i], position))));
        let distances = self.geodesics.from_known(&known).into_iter();
        Place { point, distances: distances.map(|d| (d / self.unit).min(ELSEWHERE)).collect() }
    }

    fn position(&self, point: &Point) -> [f64; 3] {
        let corners = self.mesh.corners(point.corners);
        std::array::from_fn(|c| (0..3).map(|i| point.weights[i] * corners[i][c]).sum())
    }

    fn vertex(&self, vertex: usize) -> Point {
        let corners = self.geodesics.triangles_around(vertex).next().unwrap_or([vertex as u32; 3]);
        let weights = corners.map(|corner| f64::from(u8::from(corner as usize == vertex)));
        Point { corners, weights }
    }

    /// A vertex, and a grid of points in the triangles around it.
    fn points_around(&self, vertex: usize) -> impl Iterator<Item = Point> {
        let grid = (0..=CUTS).flat_map(|i| (0..=CUTS - i).map(move |j| [i, j, CUTS - i - j]));
        let weights = grid.map(|parts| parts.map(|part| part as f64 / CUTS as f64));
        let inside = self.geodesics.triangles_around(vertex).flat_map(move |corners| {
            weights.clone().map(move |weights| Point { corners, weights })
        });
        std::iter::once(self.vertex(vertex)).chain(inside)
    }
}

/// Points of which each is the farthest from those before it. The first is the farthest from the vertex that lies
/// farthest from the centroid: an end of the shape.
fn farthest_points(surface: &Surface<'_>, count: usize) -> Vec<Place> {
    let outermost = farthest(&distances_from_centroid(surface.mesh));
    let mut next = farthest(&surface.place(surface.vertex(outermost)).distances);
    let mut nearest = vec![f64::INFINITY; surface.mesh.n()];
    (0..count)
        .map(|_| {
            let place = surface.place(surface.vertex(next));
            nearest.iter_mut().zip(&place.distances).for_each(|(n, &d)| *n = n.min(d));
            next = farthest(&nearest);
            place
        })
        .collect()
}

/// The first vertex with the largest distance.
fn farthest(distances: &[f64]) -> usize {
    lowest(0..distances.len(), |&vertex| -distances[vertex]).unwrap_or(0)
}

/// How far every vertex is from the centroid of the surface, straight through space.
fn distances_from_centroid(mesh: &TriMesh) -> Vec<f64> {
    let areas = mesh.vertex_areas();
    let area: f64 = areas.iter().sum();
    let weighted = mesh.vertices().iter().zip(&areas);
    let centroid = weighted
        .fold([0.0; 3], |sum: [f64; 3], (p, a)| std::array::from_fn(|c| sum[c] + a / area * p[c]));
    mesh.vertices().iter().map(|&p| norm(sub(p, centroid))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::mesh::subdivide::subdivide;
    use crate::mesh::trimesh::{cross, dot};
    use crate::remesh::{Family, FamilyRecipe, Operation};

    fn spot() -> TriMesh {
        crate::mesh::load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh
    }

    #[test]
    fn a_mesh_finds_its_own_landmarks() {
        // The finer one has so many vertices that it is simplified first.
        for mesh in [spot(), subdivide(&spot())] {
            let landmarks = Landmarks::of(&mesh, 16);
            let surface = Surface::of(&mesh);
            for (found, own) in landmarks.find(&surface).iter().zip(farthest_points(&surface, 16)) {
                assert_eq!(surface.position(&found.point), surface.position(&own.point));
            }
        }
    }

    #[test]
    fn numbering_does_not_matter() {
        let mesh = spot();
        let last = mesh.n() as u32 - 1;
        let vertices = mesh.vertices().iter().rev().copied().collect();
        let faces = mesh.faces().iter().rev().map(|&[a, b, c]| [c, a, b].map(|i| last - i));
        let other = TriMesh::new(vertices, faces.collect()).unwrap();
        let landmarks = Landmarks::of(&mesh, 16);
        let [own, others] = [&mesh, &other].map(|mesh| landmarks.distances_on(mesh));
        for (own, other) in own.chunks_exact(16).zip(others.chunks_exact(16).rev()) {
            assert!(own.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-10));
        }
    }

    /// The root mean square of the differences between what vertices read on `other`, and what the points of `mesh`
    /// do that are closest to them after `carry`.
    fn difference(
        landmarks: &Landmarks,
        mesh: &TriMesh,
        other: &TriMesh,
        carry: impl Fn([f64; 3]) -> [f64; 3],
    ) -> f64 {
        let surface = ClosestPoint::on(mesh);
        let [own, found] = [mesh, other].map(|mesh| landmarks.distances_on(mesh));
        let m = landmarks.count();
        let column = |i: usize| own.iter().skip(i).step_by(m).copied().collect::<Vec<_>>();
        let columns: Vec<Vec<f64>> = (0..m).map(column).collect();
        let squares = other.vertices().iter().zip(found.chunks_exact(m)).map(|(&p, found)| {
            let point = surface.to(carry(p));
            let misses = columns.iter().zip(found).map(|(c, f)| point.interpolate(mesh, c) - f);
            misses.map(|miss| miss * miss).sum::<f64>()
        });
        (squares.sum::<f64>() / found.len() as f64).sqrt()
    }

    /// Taking the nearest vertex to the place of each landmark instead gives 0.009 to 0.017.
    #[test]
    fn other_samplings_read_the_same_up_to_the_symmetry_of_the_shape() {
        let mesh = spot();
        let landmarks = Landmarks::of(&mesh, 16);
        let all = [Operation::Subdivide, Operation::Simplify, Operation::Perturb, Operation::Flip];
        for operations in [vec![Operation::Simplify], all.to_vec()] {
            let recipe = FamilyRecipe { members: 4, operations, ..FamilyRecipe::default() };
            for other in &Family::of(&mesh, &recipe).unwrap().members {
                let straight = difference(&landmarks, &mesh, other, |p| p);
                let mirrored = difference(&landmarks, &mesh, other, |[x, y, z]| [-x, y, z]);
                assert!(straight.min(mirrored) < 0.012, "{straight} {mirrored}");
                // Never some of one and some of the other.
                assert!(straight.max(mirrored) > 0.1, "{straight} {mirrored}");
            }
        }
    }

    #[test]
    fn on_the_sphere_distances_are_great_circles() {
        let landmarks = Landmarks::of(&icosphere(2), 8);
        let errors = [2, 3, 4].map(|level| {
            let mesh = icosphere(level);
            let surface = Surface::of(&mesh);
            let places = landmarks.find(&surface);
            let errors: Vec<f64> = places
                .iter()
                .flat_map(|place| {
                    let s = surface.position(&place.point);
                    let angle = move |p: [f64; 3]| norm(cross(s, p)).atan2(dot(s, p));
                    let unit = (4.0 * std::f64::consts::PI).sqrt();
                    let all = place.distances.iter().zip(mesh.vertices());
                    all.map(move |(d, &p)| d - angle(p) / unit).collect::<Vec<_>>()
                })
                .collect();
            (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
        });
        assert!(errors[0] < 0.02 && errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1]);
    }

    #[test]
    fn pieces_and_meshes_with_fewer_vertices_than_landmarks_have_finite_features() {
        let one = icosphere(0);
        let shifted = one.vertices().iter().map(|p| [p[0] + 5.0, p[1], p[2]]);
        let vertices = one.vertices().iter().copied().chain(shifted).collect();
        let faces = one.faces().iter().copied();
        let faces = faces.clone().chain(faces.map(|face| face.map(|i| i + 12))).collect();
        let two = TriMesh::new(vertices, faces).unwrap();
        for (mesh, elsewhere) in [(one, 0), (two, 12 * 16)] {
            let distances = Landmarks::of(&mesh, 16).distances_on(&mesh);
            assert!(distances.iter().all(|d| d.is_finite()));
            assert_eq!(distances.iter().filter(|&&d| d == ELSEWHERE).count(), elsewhere);
        }
    }
}
