//! Eigenfunctions in the paper's arrangement: a row of pictures for every eigenfunction, all of a row with one scale of colours.
//!
//! Signs and turns within an eigenspace are taken out: of every eigenspace the function is shown that is closest to the first of the
//! row, which is the exact one where there is a formula and FEM's elsewhere.

use std::path::Path;

use chladni::mesh::TriMesh;
use chladni::mesh::topology::component_labels;
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::publish::picture::{Picture, Scene, Up, View};
use chladni::spectrum::closed_form::{ClosedForm, projected};
use chladni::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};
use chladni::spectrum::factor::Analysis;
use chladni::spectrum::pencil::{InnerProduct, column};
use chladni::spectrum::{Dense, Eigenpairs, Problem, fem};

use super::Outcome;
use super::results::{Experiment, Solved};

/// Pixels of a picture, and between two.
const SIZE: usize = 200;
const GAP: usize = 16;

/// What a figure shows.
struct Figure {
    /// The file of the mesh, without folder, and its eigenfunctions, a row each.
    rows: Vec<(&'static str, Vec<usize>)>,
    /// Beside FEM, and the exact ones where there are any.
    variants: &'static [&'static str],
    exact: Option<ClosedForm>,
    boundary: Boundary,
    up: Up,
}

fn figure(name: &str) -> Option<Figure> {
    let square = |rows| Figure {
        rows,
        variants: &["paper", "ritz"],
        exact: Some(ClosedForm::Square),
        boundary: Boundary::Dirichlet,
        up: Up::Y,
    };
    let closed = |rows, up| Figure {
        rows,
        variants: &["paper", "ritz"],
        exact: None,
        boundary: Boundary::Neumann,
        up,
    };
    Some(match name {
        "fig3" => square(vec![("square-324-seed1.ply", vec![1, 2, 3, 4, 5])]),
        "fig4" => square(vec![
            ("square-144-seed1.ply", vec![6]),
            ("square-324-seed1.ply", vec![6]),
            ("square-700-seed1.ply", vec![6]),
            ("square-1164-seed1.ply", vec![6]),
        ]),
        "fig6" => {
            let rows = ["sphere-252-seed1.ply", "sphere-752-seed1.ply", "sphere-1502-seed1.ply"];
            let rows = rows.map(|mesh| (mesh, vec![9])).into();
            Figure { exact: Some(ClosedForm::Sphere), ..closed(rows, Up::Z) }
        }
        "fig7" => {
            let rows = ["vase-520-seed1.ply", "vase-2280-seed1.ply"];
            closed(rows.map(|mesh| (mesh, vec![2, 3, 4])).into(), Up::Z)
        }
        "fig8" => {
            let rows = ["bunny1.obj", "torus.obj"];
            closed(rows.map(|mesh| (mesh, vec![2, 3, 4, 5])).into(), Up::Y)
        }
        "fig9" => {
            let rows = ["bunny2.obj", "bunny2-T.obj", "bunny2-RoT.obj", "bunny2-SoT.obj"];
            let rows = rows.map(|mesh| (mesh, vec![5])).into();
            let variants = &["paper, edge lengths", "ritz, edge lengths", "ritz, landmarks"];
            Figure { variants, ..closed(rows, Up::Y) }
        }
        _ => return None,
    })
}

/// The pictures of an experiment, as files in `docs/paper` and a table in Markdown that shows them; of all its variants or of none.
pub fn of(experiment: &Experiment, docs: &Path) -> Outcome<String> {
    let figure = figure(&experiment.name).ok_or("no pictures are drawn of it")?;
    let exact = if figure.exact.is_some() { "exact, " } else { "" };
    let shown = figure.variants;
    let mut text =
        format!("| mesh | φ | {exact}FEM, {} | λ |\n|---|---|---|---|\n", shown.join(", "));
    for (mesh, places) in &figure.rows {
        let solved: Vec<Solved> =
            shown.iter().map(|v| experiment.solved(v, mesh)).collect::<Outcome<_>>()?;
        let on = &solved.first().ok_or("nothing was run")?.mesh;
        let seen = Seen::new(&figure, on, places)?;
        for &k in places {
            let file = format!("{}-{}-{k}.png", experiment.name, stem(mesh));
            let (pictures, values) = seen.row(on, &solved, k);
            let row = Picture::row(&pictures, GAP).ok_or("there is nothing to show")?;
            std::fs::write(docs.join("paper").join(&file), row.to_png()?)?;
            let values: Vec<String> = values.iter().map(|value| format!("{value:.4}")).collect();
            text += &format!(
                "| {} | {k} | ![φ{k} of {}](paper/{file}) | {} |\n",
                stem(mesh),
                stem(mesh),
                values.join(", ")
            );
        }
    }
    Ok(text)
}

fn stem(mesh: &str) -> &str {
    mesh.rsplit_once('.').map_or(mesh, |(stem, _)| stem)
}

/// A mesh with what is known of it without any training.
struct Seen {
    view: View,
    operators: Operators,
    fem: Eigenpairs,
    exact: Option<(Vec<f64>, Dense)>,
}

impl Seen {
    fn new(figure: &Figure, mesh: &TriMesh, places: &[usize]) -> Outcome<Self> {
        let most = places.iter().copied().max().unwrap_or(1);
        let operators = Operators::assemble(mesh, MassKind::Lumped)?;
        let problem = Problem::new(&operators, figure.boundary, &component_labels(mesh))?;
        let mut fem = fem::lowest(&problem, &Analysis::new(problem.pencil())?, most)?.pairs;
        fem.vectors = problem.extend(fem.vectors);
        let exact = figure.exact.map(|form| form.eigenpairs(mesh, figure.boundary, most));
        let exact = exact.transpose()?.map(|exact| (exact.values, exact.vectors));
        Ok(Self { view: View::of(mesh, figure.up), operators, fem, exact })
    }

    /// The pictures of φ_k with their λ: exact, FEM, then the others.
    fn row(&self, mesh: &TriMesh, solved: &[Solved], k: usize) -> (Vec<Picture>, Vec<f64>) {
        let mass = &self.operators.mass;
        let j = k - 1;
        let mut shown: Vec<(f64, Vec<f64>)> = Vec::new();
        let first = match &self.exact {
            Some((values, vectors)) => {
                shown.push((values[j], column(vectors, j).to_vec()));
                column(vectors, j).to_vec()
            }
            None => column(&self.fem.vectors, j).to_vec(),
        };
        let spaces = match &self.exact {
            Some((values, _)) => clusters(values, 1e-9, 1e-9),
            None => {
                clusters(&self.fem.values, CLUSTER_GAP, zero_below(self.operators.total_mass()))
            }
        };
        let space = spaces.into_iter().find(|space| space.contains(&j)).unwrap_or(j..k);
        let mut closest = |value: f64, vectors: &Dense| {
            let space = space.start..space.end.min(vectors.ncols());
            let phi = projected(&vectors.get(.., space).to_owned(), &first, mass);
            let norm = mass.square(&phi).sqrt();
            shown.push((value, phi.iter().map(|x| x / norm).collect()));
        };
        closest(self.fem.values[j], &self.fem.vectors);
        for solved in solved {
            closest(solved.values[j], &solved.vectors);
        }
        let sizes = shown.iter().flat_map(|(_, phi)| phi.iter().map(|x| x.abs()));
        let limit = sizes.fold(0.0, f64::max);
        let scene = Scene::of(mesh, self.view, SIZE);
        let pictures = shown.iter().map(|(_, phi)| scene.draw(phi, limit));
        (pictures.collect(), shown.iter().map(|&(value, _)| value).collect())
    }
}
