//! Each connected piece of a mesh by itself: what a closed surface is called by its genus, and how many of its faces
//! are wound against the others.

use serde::Serialize;

use super::{Classes, Topology, component_labels, sorted_half_edges};
use crate::mesh::trimesh::TriMesh;

/// A component of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Piece {
    /// V and F of it.
    pub vertices: usize,
    pub faces: usize,
    /// χ of it.
    pub euler_characteristic: i64,
    pub boundary_loops: usize,
    /// Whether its faces can be wound so that all neighbours agree. A Möbius strip's cannot.
    pub orientable: bool,
    /// The fewest faces that have to be turned over for all neighbours to agree; 0 where nothing can make them.
    pub flipped_faces: usize,
    /// The number of handles, (2 − χ − boundary loops)/2; none where it is not orientable or not manifold.
    pub genus: Option<i64>,
}

/// The components of a mesh, in the order of their lowest vertices.
pub fn pieces(mesh: &TriMesh) -> Vec<Piece> {
    let labels = component_labels(mesh);
    let count = labels.iter().max().map_or(0, |&last| last as usize + 1);
    let mut faces = vec![Vec::new(); count];
    for (index, &[vertex, ..]) in mesh.faces().iter().enumerate() {
        faces[labels[vertex as usize] as usize].push(index);
    }
    // Vertices keep their order, and each piece has its own numbers.
    let mut rows = vec![0_u32; mesh.n()];
    let mut vertices = vec![Vec::new(); count];
    for (vertex, &label) in labels.iter().enumerate() {
        let own = &mut vertices[label as usize];
        rows[vertex] = own.len() as u32;
        own.push(mesh.vertices()[vertex]);
    }
    let piece = |(vertices, faces): (Vec<[f64; 3]>, Vec<usize>)| {
        let faces = faces.into_iter().map(|f| mesh.faces()[f].map(|v| rows[v as usize]));
        TriMesh::new(vertices, faces.collect()).ok().map(|mesh| Piece::of(&mesh))
    };
    vertices.into_iter().zip(faces).filter_map(piece).collect()
}

impl Piece {
    fn of(mesh: &TriMesh) -> Self {
        let topology = Topology::of(mesh);
        let winding = flipped_faces(mesh.faces());
        let doubled = 2 - topology.euler_characteristic - topology.boundary_loops as i64;
        Self {
            vertices: topology.vertices,
            faces: topology.faces,
            euler_characteristic: topology.euler_characteristic,
            boundary_loops: topology.boundary_loops,
            orientable: winding.is_some(),
            flipped_faces: winding.unwrap_or_default(),
            genus: (winding.is_some() && topology.is_manifold()).then_some(doubled / 2),
        }
    }
}

/// How many faces have to be turned over for neighbours to agree; none where they never do. Only edges of two faces
/// make neighbours.
fn flipped_faces(faces: &[[u32; 3]]) -> Option<usize> {
    // Side 2f is face f as it is, side 2f + 1 the same turned over; sides that agree are one class.
    let mut sides = Classes::new(2 * faces.len());
    for edge in sorted_half_edges(faces).chunk_by(|a, b| a.ends == b.ends) {
        if let [one, other] = edge {
            let (f, g) = (2 * (one.from / 3), 2 * (other.from / 3));
            let turned = usize::from(one.ascending() == other.ascending());
            sides.join(f, g + turned);
            sides.join(f + 1, g + 1 - turned);
        }
    }
    // Of each pair of classes that mirror one another, how many faces lie in the class of the lowest face as it is, and in the other.
    let mut counts = vec![[0_usize; 2]; faces.len()];
    for face in 0..faces.len() {
        let (own, turned) = (sides.leader(2 * face), sides.leader(2 * face + 1));
        if own == turned {
            return None;
        }
        let lowest = own.min(turned) / 2;
        counts[lowest][(own.min(turned) % 2) ^ usize::from(own > turned)] += 1;
    }
    Some(counts.into_iter().map(|[one, other]| one.min(other)).sum())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::load;
    use crate::mesh::sample::icosphere;

    fn data(name: &str) -> TriMesh {
        load(format!("tests/data/meshes/{name}").as_ref()).unwrap().mesh
    }

    #[test]
    fn a_sphere_a_torus_and_a_strip_by_genus() {
        let [sphere] = pieces(&icosphere(1))[..] else { panic!() };
        assert_eq!((sphere.genus, sphere.orientable, sphere.flipped_faces), (Some(0), true, 0));
        assert_eq!(pieces(&data("torus.obj"))[0].genus, Some(1));
        let strip = pieces(&data("gc_moebius.obj"))[0];
        assert_eq!((strip.genus, strip.orientable, strip.boundary_loops), (None, false, 1));
    }

    #[test]
    fn the_fewest_faces_are_turned_in_every_piece() {
        let sphere = icosphere(1);
        let n = sphere.n() as u32;
        let mut faces = sphere.faces().to_vec();
        faces.extend(sphere.faces().iter().map(|face| face.map(|v| v + n)));
        // Three of the first sphere, and all but two of the second.
        faces[..3].iter_mut().for_each(|face| face.swap(0, 1));
        faces[82..].iter_mut().for_each(|face| face.swap(0, 1));
        let vertices = [sphere.vertices(), sphere.vertices()].concat();
        let found = pieces(&TriMesh::new(vertices, faces).unwrap());
        let flipped: Vec<usize> = found.iter().map(|piece| piece.flipped_faces).collect();
        assert_eq!(flipped, [3, 2]);
        assert!(found.iter().all(|piece| piece.orientable && piece.genus == Some(0)));
    }

    #[test]
    fn a_pinched_piece_has_no_genus() {
        let hourglass = pieces(&data("gc_hourglass_ico.obj"));
        assert_eq!((hourglass.len(), hourglass[0].genus), (1, None));
    }
}
