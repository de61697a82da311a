//! A picture of an SPM file: where the builder cut the mesh, its regions, and its levels of detail.

use super::seams::Seams;
use super::{InspectError, open};
use clap::ValueEnum;
use glam::DVec3;
use picture::{Align, Camera, Canvas, Color, Size, Solids, WHITE, render};
use spm::{FileError, RegionGrid, SpmFile, prefix_mesh};
use std::path::Path;

/// Width of the picture, pixels.
const WIDTH: u32 = 1100;
const GAP: u32 = 6;
/// Heights of the title, of the panels of the full mesh and of those of the levels, pixels.
const TITLE: u32 = 52;
const LARGE: u32 = 400;
const SMALL: u32 = 230;
/// Levels of detail that are shown, from the base mesh on.
const LEVELS: u32 = 4;
/// Faces that are drawn, at the most: a pixel each.
const MAX_FACES: u32 = 1_000_000;
/// Edges that are marked, at the most: beyond they cover the mesh.
const MAX_SEAMS: usize = 100_000;
/// Radius of a marked edge, half widths.
const SEAM: f64 = 0.004;
/// Radius of a marked vertex, radii of an edge: one alone must be found in the picture.
const CUT_VERTEX: f64 = 2.5;
/// Darkness of the edges of faces.
const EDGES: f64 = 0.4;

const SURFACE: Color = [206, 212, 222];
const CUT: Color = [226, 20, 20];
const BOUNDARY: Color = [20, 90, 220];
const LEVEL: Color = [250, 206, 120];
const INK: Color = [30, 30, 36];
/// Colours of regions. Cells beside each other have different ones: their number is prime and above
/// each of the steps from one cell to the next.
const REGIONS: [Color; 7] = [
    [250, 190, 120],
    [150, 200, 240],
    [190, 225, 150],
    [240, 170, 190],
    [200, 180, 240],
    [245, 230, 140],
    [150, 220, 205],
];
const STEPS: [u32; 3] = [1, 2, 4];

/// An axis of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    /// The first coordinate.
    X,
    /// The second one, upwards in most OBJ files.
    Y,
    /// The third one, upwards in most files for printers and machines.
    Z,
}

impl Axis {
    /// The direction that points upwards, and from where a model is seen: askew, from above, so
    /// that of most models two sides and the upper one are seen.
    fn up_and_eye(self) -> [DVec3; 2] {
        let [up, eye] = [DVec3::Z, DVec3::new(0.55, -0.75, 0.42)];
        match self {
            Self::X => [up, eye].map(|v| DVec3::new(v.z, v.x, v.y)),
            Self::Y => [up, eye].map(|v| DVec3::new(v.x, v.z, -v.y)),
            Self::Z => [up, eye],
        }
    }
}

/// A mesh in the model's own coordinates.
struct Mesh {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Mesh {
    fn read<D: AsRef<[u8]>>(file: &SpmFile<D>, faces: u32) -> Result<Self, FileError> {
        let (positions, triangles) = prefix_mesh(file, faces)?;
        Ok(Self {
            positions,
            triangles,
        })
    }

    fn faces(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let at = |vertex: u32| self.positions[vertex as usize];
        self.triangles.iter().map(move |corners| corners.map(at))
    }

    /// All faces in colours of their own.
    fn solids(&self, color: impl Fn([DVec3; 3]) -> Color) -> Solids {
        let mut solids = Solids::default();
        for corners in self.faces() {
            solids.face(corners, color(corners), EDGES);
        }
        solids
    }
}

/// Draws an SPM file as a PNG file.
///
/// # Errors
/// When the file is missing, refused or damaged.
pub fn model_picture(path: &Path, up: Axis) -> Result<Vec<u8>, InspectError> {
    let file = open(path)?;
    let refused = |error| InspectError::File {
        path: path.to_path_buf(),
        error,
    };
    let canvas = draw(&file, path, up).map_err(refused)?;
    canvas.to_png().map_err(|error| InspectError::Picture {
        path: path.to_path_buf(),
        error,
    })
}

fn draw<D: AsRef<[u8]>>(file: &SpmFile<D>, path: &Path, up: Axis) -> Result<Canvas, FileError> {
    let header = file.model_header();
    let full = Mesh::read(file, header.faces.min(MAX_FACES))?;
    let [up, eye] = up.up_and_eye();
    let half = (WIDTH - GAP) / 2;
    let aspect = f64::from(half) / f64::from(LARGE);
    let camera = Camera::around(full.faces().flatten(), eye, up, aspect);
    let seams = Seams::of(&full.positions, &full.triangles);
    let mut canvas = Canvas::new(WIDTH, TITLE + LARGE + GAP + SMALL, [250, 250, 252]);
    write_title(&mut canvas, path, &full, header.faces, &seams);

    let mut solids = full.solids(|_| SURFACE);
    solids.begin_marks();
    mark(&mut solids, &seams, SEAM * camera.half_width());
    let mut panel = render(&solids, &camera, half, LARGE, WHITE);
    write_key(&mut panel);
    canvas.paste(&panel, 0, TITLE);

    let origin = DVec3::from_array(header.origin);
    let solids = full.solids(|[a, b, c]| region_color(&header.grid, (a + b + c) / 3.0 - origin));
    let mut panel = render(&solids, &camera, half, LARGE, WHITE);
    let words = format!("{} regions, the cells of the grid", file.regions().len());
    panel.write((8, 6), Align::Left, Size::Normal, INK, &words);
    canvas.paste(&panel, half + GAP, TITLE);

    let width = (WIDTH - GAP * (LEVELS - 1)) / LEVELS;
    for level in 0..LEVELS {
        let faces = level_faces(header.base_faces, header.faces.min(MAX_FACES), level);
        let mesh = Mesh::read(file, faces)?;
        let camera = Camera::around(
            full.faces().flatten(),
            eye,
            up,
            f64::from(width) / f64::from(SMALL),
        );
        let mut panel = render(&mesh.solids(|_| LEVEL), &camera, width, SMALL, WHITE);
        let words = match level {
            0 => format!("base mesh, {} faces", mesh.triangles.len()),
            _ => format!("{} faces", mesh.triangles.len()),
        };
        panel.write((6, 4), Align::Left, Size::Small, INK, &words);
        canvas.paste(&panel, level * (width + GAP), TITLE + LARGE + GAP);
    }
    Ok(canvas)
}

/// Faces of a level: by equal ratios from the base mesh to the full one.
fn level_faces(base: u32, full: u32, level: u32) -> u32 {
    if level + 1 == LEVELS {
        return full;
    }
    let share = f64::from(level) / f64::from(LEVELS - 1);
    let ratio = f64::from(full) / f64::from(base.max(1));
    (f64::from(base) * ratio.powf(share)).round() as u32
}

fn region_color(grid: &RegionGrid, point: DVec3) -> Color {
    let cell = grid.region_of_point(point).cell().to_array();
    let place: u32 = cell.iter().zip(STEPS).map(|(of, step)| of * step).sum();
    REGIONS[place as usize % REGIONS.len()]
}

fn mark(solids: &mut Solids, seams: &Seams, radius: f64) {
    let color = |is_cut: bool| if is_cut { CUT } else { BOUNDARY };
    for seam in seams.edges.iter().take(MAX_SEAMS) {
        let [from, to] = seam.ends;
        solids.tube(from, to, radius, color(seam.is_cut));
    }
    for &place in seams.cut_vertices.iter().take(MAX_SEAMS) {
        solids.ball(place, CUT_VERTEX * radius, CUT);
    }
}

fn write_title(canvas: &mut Canvas, path: &Path, full: &Mesh, faces: u32, seams: &Seams) {
    let name = path.file_name().unwrap_or(path.as_os_str());
    let shown = full.triangles.len();
    let title = match () {
        () if shown < faces as usize => {
            format!("{}: {shown} of {faces} faces", name.to_string_lossy())
        }
        () => format!("{}: {faces} faces", name.to_string_lossy()),
    };
    canvas.write((16, 8), Align::Left, Size::Large, INK, &title);
    let (cut, all) = (seams.cut_edges(), seams.edges.len());
    let words = format!(
        "edges cut: {cut}, vertices cut: {}, boundary edges: {}",
        seams.cut_vertices.len(),
        all - cut
    );
    canvas.write((16, 31), Align::Left, Size::Small, INK, &words);
}

fn write_key(panel: &mut Canvas) {
    let keys = [
        (CUT, "cut: a coarse mesh may have a crack here"),
        (BOUNDARY, "boundary"),
    ];
    for ((color, words), top) in keys.into_iter().zip([8, 26]) {
        panel.fill(8, top, 14, 10, color);
        panel.write((28, top - 1), Align::Left, Size::Small, INK, words);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_beside_each_other_differ_in_colour() {
        let grid = RegionGrid::new(DVec3::ZERO, DVec3::splat(8.0), 8).unwrap();
        let color = |x: f64, y: f64, z: f64| region_color(&grid, DVec3::new(x, y, z));
        let here = color(3.5, 3.5, 3.5);
        for beside in [
            color(4.5, 3.5, 3.5),
            color(3.5, 2.5, 3.5),
            color(3.5, 3.5, 4.5),
        ] {
            assert_ne!(here, beside);
        }
    }

    #[test]
    fn a_model_is_seen_from_above_whichever_axis_points_upwards() {
        for (axis, expected) in [
            (Axis::X, DVec3::X),
            (Axis::Y, DVec3::Y),
            (Axis::Z, DVec3::Z),
        ] {
            let [up, eye] = axis.up_and_eye();
            assert_eq!(up, expected);
            assert_eq!(eye.dot(up), 0.42);
        }
    }

    #[test]
    fn levels_go_from_the_base_mesh_to_the_full_one() {
        let levels = [0, 1, 2, 3].map(|level| level_faces(100, 100_000, level));
        assert_eq!(levels, [100, 1000, 10_000, 100_000]);
    }
}
