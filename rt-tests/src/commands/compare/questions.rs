//! The questions that every contender gets, and the files that hand them to others.
//!
//! | file | holds, little-endian |
//! |---|---|
//! | `mesh.bin`, `tool240.bin`, `tool960.bin` | u64 vertices, u64 faces, f64[3] a vertex, u32[3] a face |
//! | `tips.bin` | f64[3] a point of the path |
//! | `poses240.bin`, `poses960.bin` | f64[7] a pose of the tool: x y z, quaternion x y z w |
//! | `WHO.TASK.answers` | f64[2] a question, written by who was asked: nanoseconds, answer |

use super::closest;
use super::tools::{self, Touch};
use crate::failure::{Chosen, Failure};
use crate::models::Model;
use crate::models::surface::Surface;
use crate::report::output::{make_folder_at, write_whole_at};
use glam::DVec3;
use hrtc_core::contact::tool::ToolMesh;
use rand::Rng;
use std::path::Path;

/// The full mesh as any library takes it: its vertices alone, in the order in which its faces name
/// them, which are those of the model in their order.
pub struct FullMesh {
    pub positions: Vec<DVec3>,
    pub faces: Vec<[u32; 3]>,
}

impl FullMesh {
    pub fn new(model: &Model) -> Self {
        let (positions, faces) = model.full_mesh();
        Self { positions, faces }
    }
}

/// A tool, and where it touches.
pub struct ToolQuestions {
    /// The task.
    pub task: &'static str,
    /// The tool.
    pub mesh: ToolMesh,
    /// Its poses, one behind the other.
    pub poses: Vec<Touch>,
    /// All pairs that meet at each pose, as [`tools::Digest`] over places in the full mesh.
    pub expected: Vec<f64>,
}

/// What is asked about one model.
pub struct Questions {
    /// Points of a path.
    pub tips: Vec<DVec3>,
    /// How far the full mesh is from each.
    pub expected: Vec<f64>,
    /// For each tool of [`tools::TOOLS`].
    pub tools: Vec<ToolQuestions>,
}

impl Questions {
    /// A path over a model; a tool touches at every so many of its points.
    ///
    /// # Errors
    /// When a tool is none.
    pub fn new(
        model: &Model,
        full: &Surface,
        every: usize,
        random: &mut impl Rng,
    ) -> Result<Self, Failure> {
        let touches = closest::touches(model, full, random);
        let tips = closest::tips(model, &touches);
        let mut near = 0;
        let mut distance = |&tip: &DVec3| {
            let found = full.nearest(tip, near);
            near = found.triangle;
            found.distance
        };
        let expected = tips.iter().map(&mut distance).collect();
        let faces: Vec<_> = (0u32..).zip(full.triangles().iter().copied()).collect();
        let tool = |kind| -> Result<ToolQuestions, Failure> {
            let (mesh, length, depth) = tools::capsule(model, kind);
            let at = touches.iter().step_by(every);
            let poses: Vec<Touch> = at.filter_map(|&at| Touch::new(at, length, depth)).collect();
            let mut tool = tools::new_tool(model, &mesh)?;
            let expected = poses.iter().map(|touch| {
                tool.place(&touch.to_query);
                tools::by_search(&faces, &tool)
            });
            Ok(ToolQuestions {
                task: kind.0,
                expected: expected.collect(),
                mesh,
                poses,
            })
        };
        let tools = tools::TOOLS
            .map(tool)
            .into_iter()
            .collect::<Result<_, _>>()?;
        Ok(Self {
            tips,
            expected,
            tools,
        })
    }

    /// Writes all of it.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, mesh: &FullMesh, chosen: Chosen, folder: &Path) -> Result<(), Failure> {
        make_folder_at(chosen, folder)?;
        let write = |name: &str, bytes: Vec<u8>| {
            let path = folder.join(name);
            write_whole_at(chosen, &path, &bytes)
        };
        write("mesh.bin", mesh_bytes(&mesh.positions, &mesh.faces))?;
        write(
            "tips.bin",
            bytes(self.tips.iter().flat_map(|p| p.to_array())),
        )?;
        for tool in &self.tools {
            let faces = tool
                .task
                .trim_start_matches("tool")
                .trim_end_matches("_pairs");
            let mesh = mesh_bytes(&tool.mesh.positions, &tool.mesh.triangles);
            write(&format!("tool{faces}.bin"), mesh)?;
            let poses = tool.poses.iter().flat_map(|touch| {
                let [x, y, z, w] = touch.pose.orientation.to_array();
                let at = touch.pose.position;
                [at.x, at.y, at.z, x, y, z, w]
            });
            write(&format!("poses{faces}.bin"), bytes(poses))?;
        }
        Ok(())
    }
}

fn bytes(numbers: impl Iterator<Item = f64>) -> Vec<u8> {
    numbers.flat_map(f64::to_le_bytes).collect()
}

fn mesh_bytes(positions: &[DVec3], faces: &[[u32; 3]]) -> Vec<u8> {
    let mut out = Vec::new();
    for count in [positions.len(), faces.len()] {
        out.extend((count as u64).to_le_bytes());
    }
    out.extend(bytes(positions.iter().flat_map(|p| p.to_array())));
    out.extend(faces.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::source::open;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    #[test]
    fn the_files_hold_every_question() {
        let model = open("relief:3000").unwrap_or_else(|error| panic!("{error}"));
        let full = Surface::new(model.full_triangles());
        let mesh = FullMesh::new(&model);
        for (face, &triangle) in mesh.faces.iter().zip(full.triangles()) {
            assert_eq!(face.map(|v| mesh.positions[v as usize]), triangle);
        }
        assert_eq!(mesh.positions.len(), model.full_vertices().len());
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
        let asked = Questions::new(&model, &full, 500, random);
        let asked = asked.unwrap_or_else(|error| panic!("{error}"));
        let folder = tempfile::tempdir().expect("a folder");
        let written = asked.write(&mesh, Chosen::EXPORT, folder.path());
        assert_eq!(written, Ok(()));
        let length = |name: &str| {
            let file = std::fs::read(folder.path().join(name));
            file.map_or(0, |bytes| bytes.len())
        };
        assert_eq!(length("tips.bin"), 24 * asked.tips.len());
        let of_mesh = |v: usize, f: usize| 16 + 24 * v + 12 * f;
        assert_eq!(
            length("mesh.bin"),
            of_mesh(mesh.positions.len(), mesh.faces.len())
        );
        for (tool, faces) in asked.tools.iter().zip(["240", "960"]) {
            let of_tool = of_mesh(tool.mesh.positions.len(), tool.mesh.triangles.len());
            assert_eq!(length(&format!("tool{faces}.bin")), of_tool);
            assert_eq!(tool.poses.len(), tool.expected.len());
            assert_eq!(length(&format!("poses{faces}.bin")), 56 * tool.poses.len());
        }
    }
}
