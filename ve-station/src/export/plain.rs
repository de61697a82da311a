//! Plain meshes: OBJ, PLY, STL, OFF.

use super::Front;
use spm::NONE;
use std::io::{self, Write};

/// A front as positions and corners.
pub(super) struct Surface {
    /// In the coordinates of the mesh file that the model was built from.
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// Whether f32 holds the positions.
    single: bool,
}

impl Surface {
    pub(super) fn of(front: &Front) -> Self {
        let sizes = front.header.sizes();
        let mut number = vec![NONE; sizes.vt(sizes.vsps) as usize];
        let mut surface = Self {
            positions: Vec::with_capacity(sizes.base_vertices as usize + front.splits.len()),
            triangles: Vec::with_capacity(front.faces as usize),
            single: front.is_single(),
        };
        front.refined.for_each_active_face(|face| {
            let corners = front.refined.face(face).corners.map(|vertex| {
                let number = &mut number[vertex as usize];
                if *number == NONE {
                    *number = surface.positions.len() as u32;
                    surface.positions.push(front.position(vertex));
                }
                *number
            });
            surface.triangles.push(corners);
        });
        surface
    }

    /// Three coordinates in the fewest digits that say which number it is.
    fn digits(&self, p: [f64; 3]) -> String {
        if self.single {
            let [x, y, z] = p.map(|x| x as f32);
            format!("{x:?} {y:?} {z:?}")
        } else {
            let [x, y, z] = p;
            format!("{x:?} {y:?} {z:?}")
        }
    }

    pub(super) fn write_obj(&self, out: &mut impl Write) -> io::Result<()> {
        for &p in &self.positions {
            writeln!(out, "v {}", self.digits(p))?;
        }
        for [a, b, c] in &self.triangles {
            writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
        }
        Ok(())
    }

    pub(super) fn write_off(&self, out: &mut impl Write) -> io::Result<()> {
        let (vertices, faces) = (self.positions.len(), self.triangles.len());
        writeln!(out, "OFF\n{vertices} {faces} 0")?;
        for &p in &self.positions {
            writeln!(out, "{}", self.digits(p))?;
        }
        for [a, b, c] in &self.triangles {
            writeln!(out, "3 {a} {b} {c}")?;
        }
        Ok(())
    }

    pub(super) fn write_ply(&self, out: &mut impl Write) -> io::Result<()> {
        spm_builder::write_ply(&self.positions, &self.triangles, self.single, out)
    }

    /// Binary; as text where f32, which is all that a binary file has, would move the vertices.
    pub(super) fn write_stl(&self, out: &mut impl Write) -> io::Result<()> {
        if self.single {
            self.write_binary_stl(out)
        } else {
            self.write_text_stl(out)
        }
    }

    fn write_text_stl(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "solid model")?;
        for corners in &self.triangles {
            // No normal: readers take it from the corners.
            writeln!(out, "facet normal 0 0 0\nouter loop")?;
            for p in corners.map(|v| self.positions[v as usize]) {
                writeln!(out, "vertex {}", self.digits(p))?;
            }
            writeln!(out, "endloop\nendfacet")?;
        }
        writeln!(out, "endsolid model")
    }

    fn write_binary_stl(&self, out: &mut impl Write) -> io::Result<()> {
        // A head that does not start with "solid".
        let mut head = [b' '; 80];
        head[..10].copy_from_slice(b"binary STL");
        out.write_all(&head)?;
        out.write_all(&(self.triangles.len() as u32).to_le_bytes())?;
        for corners in &self.triangles {
            // No normal: readers take it from the corners.
            out.write_all(&[0; 12])?;
            for x in corners.map(|v| self.positions[v as usize]).as_flattened() {
                out.write_all(&(*x as f32).to_le_bytes())?;
            }
            out.write_all(&[0; 2])?;
        }
        Ok(())
    }
}
