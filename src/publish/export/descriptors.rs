//! `descriptors.npz`: descriptors of a mesh and of its vertices for numpy. It holds what was asked for, and `schema`.
//!
//! With n vertices, K pairs of which c have λ = 0, in the order of the vertices and pairs of `eigen.npz`:
//!
//! | array                  | type    | shape   | content                                              |
//! |------------------------|---------|---------|------------------------------------------------------|
//! | `hks_times`            | float64 | (100,)  | t, (input unit)²                                     |
//! | `hks`                  | float64 | (n,100) | k_t(x, x), 1/(input unit)²                           |
//! | `hks_scaled`           | float64 | (n,100) | the same over the heat trace                         |
//! | `wks_energies`         | float64 | (100,)  | e, logarithms of 1/(input unit)²                     |
//! | `wks_sigma`            | float64 | ()      | σ                                                    |
//! | `wks`                  | float64 | (n,100) | WKS(x, e), 1/(input unit)²                           |
//! | `gps`                  | float64 | (n,K−c) | φ_k(x)/√λ_k                                          |
//! | `shape_dna`            | float64 | (K,)    | λ times the area                                     |
//! | `spectral_coordinates` | float64 | (n,3)   | the first three φ of λ > 0, 1/(input unit)           |
//! | `schema`               | str     | ()      | `chladni-descriptors-1`                              |

use crate::descriptors::coordinates::spectral_coordinates;
use crate::descriptors::global_point::gps;
use crate::descriptors::heat_kernel::{self, TIMES, hks, scaled_hks};
use crate::descriptors::shape_dna::{Normalisation, shape_dna};
use crate::descriptors::wave_kernel::{ENERGIES, Energies, wks};
use crate::descriptors::{Basis, Descriptor, TooFew};
use crate::mesh::Area;
use crate::publish::arrays::Arrays;
use crate::publish::npz::rows;
use crate::spectrum::Dense;

/// The name of the file.
pub const FILE: &str = "descriptors.npz";

/// The value of the array `schema`.
const SCHEMA: &str = "chladni-descriptors-1";

/// The bytes of `descriptors.npz`, of a mesh of this area.
///
/// # Errors
/// When there are too few eigenpairs for one of them.
pub fn to_npz(asked: &[Descriptor], basis: &Basis<'_>, area: Area) -> Result<Vec<u8>, TooFew> {
    let mut npz = Arrays::new();
    let mut asked = asked.to_vec();
    asked.sort_unstable();
    asked.dedup();
    let matrix = |npz: &mut Arrays, name: &str, x: &Dense| {
        npz.floats(name, &[x.nrows(), x.ncols()], rows(x));
    };
    for descriptor in asked {
        match descriptor {
            Descriptor::Hks => {
                let times = heat_kernel::times(basis, TIMES)?;
                npz.floats("hks_times", &[TIMES], times.iter().copied());
                matrix(&mut npz, "hks", &hks(basis, &times));
                matrix(&mut npz, "hks_scaled", &scaled_hks(basis, &times));
            }
            Descriptor::Wks => {
                let energies = Energies::of(basis, ENERGIES)?;
                npz.floats("wks_energies", &[ENERGIES], energies.e.iter().copied());
                npz.floats("wks_sigma", &[], [energies.sigma]);
                matrix(&mut npz, "wks", &wks(basis, &energies));
            }
            Descriptor::Gps => matrix(&mut npz, "gps", &gps(basis)?),
            Descriptor::ShapeDna => {
                let dna = shape_dna(basis.values, Normalisation::Area(area.0));
                npz.floats("shape_dna", &[dna.len()], dna);
            }
            Descriptor::SpectralCoordinates => {
                matrix(&mut npz, "spectral_coordinates", &spectral_coordinates(basis)?);
            }
        }
    }
    npz.text("schema", SCHEMA);
    Ok(npz.into_bytes())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use npyz::npz::NpzArchive;

    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::Boundary;
    use crate::spectrum::Eigenpairs;
    use crate::spectrum::closed_form::ClosedForm;

    #[test]
    fn it_holds_what_was_asked_for_in_whatever_order() {
        let exact = ClosedForm::Sphere.eigenpairs(&icosphere(1), Boundary::Neumann, 9).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, 12.0);
        let bytes = to_npz(&Descriptor::ALL, &basis, Area(12.0)).unwrap();
        let mut reversed = Descriptor::ALL;
        reversed.reverse();
        assert_eq!(to_npz(&reversed, &basis, Area(12.0)).unwrap(), bytes);
        let mut npz = NpzArchive::new(Cursor::new(bytes)).unwrap();
        let mut shape = |name: &str| npz.by_name(name).unwrap().unwrap().shape().to_vec();
        assert_eq!(shape("hks"), [42, 100]);
        assert_eq!(shape("hks_times"), [100]);
        assert_eq!(shape("hks_scaled"), [42, 100]);
        assert_eq!(shape("wks"), [42, 100]);
        assert_eq!(shape("wks_sigma"), [0; 0]);
        assert_eq!(shape("gps"), [42, 8]);
        assert_eq!(shape("spectral_coordinates"), [42, 3]);
        let dna = npz.by_name("shape_dna").unwrap().unwrap().into_vec::<f64>().unwrap();
        assert_eq!((dna.len(), dna[1], dna[8]), (9, 24.0, 72.0));

        let one = to_npz(&[Descriptor::Gps], &basis, Area(12.0)).unwrap();
        let npz = NpzArchive::new(Cursor::new(one)).unwrap();
        let mut names: Vec<String> = npz.array_names().map(Into::into).collect();
        names.sort();
        assert_eq!(names, ["gps", "schema"]);
    }
}
