//! Pictures of functions on a mesh, with their nodal lines: what Chladni's sand shows.
//!
//! - [`view`](View): where one looks from
//! - [`Scene`]: a mesh as it is seen, to draw functions on
//! - `raster`: which point of the surface is behind every pixel
//! - [`Picture`]: pixels, several side by side, PNG
//!
//! Colours are viridis, which is perceptually uniform, from −limit to limit: pictures with one limit can be compared. The nodal
//! line, where the function is 0, is black. The same function gives the same bytes.

mod raster;
mod view;

use std::sync::LazyLock;

use colorous::VIRIDIS;

use crate::mesh::TriMesh;
use raster::{Raster, Sample};
pub use view::{Up, View};

/// Subpixels along one side of a pixel.
const FINE: usize = 3;

/// Half the width of a nodal line, in subpixels.
const LINE: usize = 2;

/// Paper.
const WHITE: [f64; 3] = [255.0; 3];

/// Ink.
const BLACK: [f64; 3] = [20.0; 3];

/// Pixels, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    /// Red, green, blue of every pixel.
    pixels: Vec<[u8; 3]>,
}

/// A mesh as it is seen, to draw functions on.
pub struct Scene {
    size: usize,
    fine: Raster,
}

impl Scene {
    /// For square pictures of `size` pixels a side.
    pub fn of(mesh: &TriMesh, view: View, size: usize) -> Self {
        Self { size, fine: Raster::of(mesh, view, size * FINE) }
    }

    /// A function at the vertices. Values of ±`limit` and beyond have the ends of the colour map.
    pub fn draw(&self, values: &[f64], limit: f64) -> Picture {
        let (size, seen) = (self.size, &self.fine.samples);
        let values = self.fine.values(values);
        let line = self.fine.nodal_line(&values, LINE);
        let colour = |at: usize| match (seen[at], line[at]) {
            (None, _) => WHITE,
            (Some(_), true) => BLACK,
            (Some(Sample { light, .. }), false) => {
                let place = if limit > 0.0 { 0.5 + 0.5 * values[at] / limit } else { 0.5 };
                let nearest = (place.clamp(0.0, 1.0) * (SHADES - 1) as f64).round() as usize;
                COLOURS[nearest].map(|c| f64::from(light) * c)
            }
        };
        let pixel = |at: usize| {
            let (row, column) = (at / size * FINE, at % size * FINE);
            let mut sum = [0.0; 3];
            for (i, j) in (0..FINE).flat_map(|i| (0..FINE).map(move |j| (i, j))) {
                let fine = colour((row + i) * size * FINE + column + j);
                sum.iter_mut().zip(fine).for_each(|(sum, c)| *sum += c);
            }
            sum.map(|c| (c / (FINE * FINE) as f64).round() as u8)
        };
        Picture { width: size, height: size, pixels: (0..size * size).map(pixel).collect() }
    }
}

/// More shades than a byte can tell apart.
const SHADES: usize = 1024;

/// The colours from one end of the map to the other.
static COLOURS: LazyLock<Vec<[f64; 3]>> = LazyLock::new(|| {
    let shade = |i: usize| VIRIDIS.eval_continuous(i as f64 / (SHADES - 1) as f64);
    (0..SHADES).map(shade).map(|colour| [colour.r, colour.g, colour.b].map(f64::from)).collect()
});

impl Picture {
    /// Pictures of one height side by side, `gap` pixels apart. `None` for none, or for different heights.
    pub fn row(pictures: &[Self], gap: usize) -> Option<Self> {
        let height = pictures.first()?.height;
        if pictures.iter().any(|picture| picture.height != height) {
            return None;
        }
        let width = pictures.iter().map(|p| p.width).sum::<usize>() + gap * (pictures.len() - 1);
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for (i, picture) in pictures.iter().enumerate() {
                if i > 0 {
                    pixels.extend(std::iter::repeat_n([255; 3], gap));
                }
                let start = row * picture.width;
                pixels.extend_from_slice(&picture.pixels[start..start + picture.width]);
            }
        }
        Some(Self { width, height, pixels })
    }

    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// When the picture is larger than such a file can be, or empty.
    pub fn to_png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, side(self.width), side(self.height));
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::Balanced);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(self.pixels.as_flattened())?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::{Shape, icosphere};

    const SIZE: usize = 60;

    fn coordinate(mesh: &TriMesh, axis: usize) -> Vec<f64> {
        mesh.vertices().iter().map(|p| p[axis]).collect()
    }

    fn at(picture: &Picture, x: usize, y: usize) -> [u8; 3] {
        picture.pixels[y * picture.width + x]
    }

    #[test]
    fn a_square_lies_flat_with_its_nodal_line_where_the_function_is_zero() {
        let mesh = Shape::Square.sample(200, 0, 0).unwrap();
        let values: Vec<f64> = coordinate(&mesh, 0).iter().map(|x| x - 1.5).collect();
        let picture = Scene::of(&mesh, View::of(&mesh, Up::Y), SIZE).draw(&values, 1.5);
        let (left, right) = (at(&picture, 5, 30), at(&picture, 54, 30));
        assert!(left[2] > left[0] && right[0] > right[2], "purple {left:?}, yellow {right:?}");
        let line = (0..SIZE)
            .min_by_key(|&x| at(&picture, x, 30).iter().map(|&c| u32::from(c)).sum::<u32>());
        // 1.5 of π, with a margin on either side.
        assert!((26..31).contains(&line.unwrap()), "{line:?}");
        assert_eq!(at(&picture, 0, 0), [255; 3]);
    }

    #[test]
    fn a_sphere_is_a_disc_and_its_back_is_not_seen() {
        let mesh = icosphere(3);
        let view = View::of(&mesh, Up::Y);
        let towards: Vec<f64> = mesh.vertices().iter().map(|p| view.depth(p)).collect();
        let picture = Scene::of(&mesh, view, SIZE).draw(&towards, 1.0);
        let inside = picture.pixels.iter().filter(|&&p| p != [255; 3]).count() as f64;
        let disc = std::f64::consts::PI / 4.0 * (SIZE * SIZE) as f64;
        assert!((0.75..1.0).contains(&(inside / disc)), "{}", inside / disc);
        // The front is on one side of 0 alone: its middle is at one end of the colours, and no line runs through it.
        let [r, g, b] = at(&picture, SIZE / 2, SIZE / 2);
        assert!(r > 150 && g > 150 && b < 100, "{:?}", [r, g, b]);
    }

    #[test]
    fn where_a_mesh_is_and_its_unit_do_not_change_its_picture() {
        let mesh = icosphere(3);
        let picture = |unit: f64, away: f64| {
            let place = |p: &[f64; 3]| p.map(|x| unit * x + away);
            let vertices = mesh.vertices().iter().map(place).collect();
            let moved = TriMesh::new(vertices, mesh.faces().to_vec()).unwrap();
            Scene::of(&moved, View::of(&moved, Up::Y), SIZE).draw(&coordinate(&mesh, 0), 1.0)
        };
        let (here, there) = (picture(1.0, 0.0), picture(1.0, 1e7));
        let off = here.pixels.iter().zip(&there.pixels).filter(|(a, b)| a != b).count();
        assert!(off < SIZE, "{off} pixels at an edge");
        for unit in [1e-60, 1e60] {
            assert_eq!(picture(unit, 0.0).pixels.len(), here.pixels.len());
            let scaled = picture(unit, 0.0);
            let off = here.pixels.iter().zip(&scaled.pixels).filter(|(a, b)| a != b).count();
            assert!(off < SIZE, "{off} pixels in units of {unit}");
        }
    }

    #[test]
    fn a_row_is_as_wide_as_its_pictures_and_png_says_so() {
        let mesh = icosphere(1);
        let one = Scene::of(&mesh, View::of(&mesh, Up::Y), 20).draw(&coordinate(&mesh, 1), 1.0);
        let row = Picture::row(&[one.clone(), one.clone()], 5).unwrap();
        assert_eq!((row.width, row.height, row.pixels.len()), (45, 20, 900));
        let bytes = row.to_png().unwrap();
        assert_eq!(bytes, row.to_png().unwrap());
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut read = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut read).unwrap();
        assert_eq!(read, row.pixels.as_flattened());
        assert_eq!(Picture::row(&[], 5), None);
    }
}
