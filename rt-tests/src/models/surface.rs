//! Exact distances to any set of triangles, and points spread over it: the oracle of the checks.
//!
//! Parry's tree finds the candidates; the distance to a triangle is that of `geometry`, which
//! parry's agrees with and which has no absolute tolerance.

use geometry::closest_point_on_triangle;
use glam::DVec3;
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use rand::Rng;

/// Triangles with a tree over them.
pub struct Surface {
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
}

/// The nearest triangle of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Which triangle.
    pub triangle: u32,
    /// How far it is.
    pub distance: f64,
    /// The nearest point on it.
    pub point: DVec3,
}

impl Surface {
    /// Over at least one triangle.
    #[must_use]
    pub fn new(triangles: Vec<[DVec3; 3]>) -> Self {
        assert!(!triangles.is_empty(), "a surface has a triangle");
        let boxes: Vec<Aabb> = triangles
            .iter()
            .map(|&[a, b, c]| Aabb::new(a.min(b).min(c), a.max(b).max(c)))
            .collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        Self { triangles, tree }
    }

    /// The triangles.
    #[must_use]
    pub fn triangles(&self) -> &[[DVec3; 3]] {
        &self.triangles
    }

    /// Where the surface is nearest to a point. `hint`, any triangle, gives the first bound.
    #[must_use]
    pub fn nearest(&self, point: DVec3, hint: u32) -> Near {
        let to = |triangle: u32| {
            let found = closest_point_on_triangle(self.triangles[triangle as usize], point);
            (found.distance_squared, found.point)
        };
        let (first, on_first) = to(hint);
        // Squared distances are the costs.
        let box_cost = |node: &parry3d_f64::partitioning::BvhNode, _: f64| {
            (node.mins() - point)
                .max(point - node.maxs())
                .max(DVec3::ZERO)
                .length_squared()
        };
        let better = self.tree.find_best(first, box_cost, |leaf, _| {
            let (squared, on) = to(leaf);
            Some(Candidate { squared, on })
        });
        let (triangle, squared, on) =
            better.map_or((hint, first, on_first), |(leaf, c)| (leaf, c.squared, c.on));
        Near {
            triangle,
            distance: squared.sqrt(),
            point: on,
        }
    }

    /// About `count` points spread evenly over the area, each with its triangle: one in each
    /// stretch of equal area of all triangles in a row, so neighbours in the list lie close
    /// together.
    pub fn spread(&self, count: u32, random: &mut impl Rng) -> Vec<(u32, DVec3)> {
        let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length() * 0.5;
        let total: f64 = self.triangles.iter().map(area).sum();
        let step = total / f64::from(count);
        let mut points = Vec::with_capacity(count as usize + 1);
        let mut sum = 0.0;
        let mut next = unit(random) * step;
        for (index, triangle) in (0u32..).zip(&self.triangles) {
            sum += area(triangle);
            // A step of no size (no area at all) ends with the first point.
            while next < sum && points.len() <= count as usize {
                points.push((index, inside(triangle, random)));
                next += step;
            }
        }
        points
    }
}

/// An even random number in 0..1.
pub fn unit(random: &mut impl Rng) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A random point of a triangle, evenly by area.
pub fn inside(&[a, b, c]: &[DVec3; 3], random: &mut impl Rng) -> DVec3 {
    let root = unit(random).sqrt();
    let (v, w) = (root * (1.0 - unit(random)), root);
    // Weights 1 - w, v, w - v.
    a * (1.0 - w) + b * v + c * (w - v)
}

struct Candidate {
    squared: f64,
    on: DVec3,
}

impl parry3d_f64::partitioning::BvhLeafCost for Candidate {
    fn cost(&self) -> f64 {
        self.squared
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngCore, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    fn soup(random: &mut Xoshiro256PlusPlus) -> Vec<[DVec3; 3]> {
        let mut point = || DVec3::new(unit(random), unit(random), unit(random));
        (0..300)
            .map(|_| {
                let at = point();
                [0.0, 0.1, 0.05].map(|size| at + point() * size)
            })
            .collect()
    }

    #[test]
    fn the_nearest_triangle_is_that_of_a_search_through_all() {
        println!("seed 1");
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let surface = Surface::new(soup(&mut random));
        for _ in 0..2000 {
            let point = DVec3::new(unit(&mut random), unit(&mut random), unit(&mut random));
            let hint = random.next_u32() % 300;
            let near = surface.nearest(point, hint);
            let least = surface
                .triangles()
                .iter()
                .map(|&t| closest_point_on_triangle(t, point).distance_squared)
                .fold(f64::INFINITY, f64::min);
            assert_eq!(near.distance, least.sqrt());
            assert_eq!(near.point.distance(point), near.distance);
        }
    }

    #[test]
    fn points_are_spread_by_area_and_lie_on_their_triangles() {
        println!("seed 2");
        let mut random = Xoshiro256PlusPlus::seed_from_u64(2);
        let surface = Surface::new(soup(&mut random));
        let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length() * 0.5;
        let total: f64 = surface.triangles().iter().map(area).sum();
        let points = surface.spread(30_000, &mut random);
        let mut counts = vec![0.0; surface.triangles().len()];
        for (triangle, point) in points {
            counts[triangle as usize] += 1.0;
            let on = closest_point_on_triangle(surface.triangles()[triangle as usize], point);
            assert!(on.distance_squared < 1e-28, "{}", on.distance_squared);
        }
        for (triangle, count) in surface.triangles().iter().zip(counts) {
            let expected = 30_000.0 * area(triangle) / total;
            assert!((count - expected).abs() <= 1.01, "{count} of {expected}");
        }
    }
}
