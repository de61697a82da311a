//! Vertices in flight leave no trace: however splits and collapses take off, turn, are broken off
//! by others and land, the mesh is in the end that of the front, bit for bit; on the way its
//! certified error holds.

use crate::common::{active_faces, build, load, made_meshes, real_meshes_where};
use glam::DVec3;
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{FrontWalk, OperationFaces, SpmParts};
use std::collections::HashMap;

/// The leaves of the full mesh that a vertex stands for.
struct Leaves {
    children: HashMap<u32, [u32; 2]>,
}

impl Leaves {
    fn new(parts: &SpmParts) -> Self {
        let base = parts.header.base_vertices;
        let of = |i: u32| [base + 2 * i, base + 2 * i + 1];
        let records = parts.records.iter();
        Self {
            children: records.map(|record| (record.vs, of(record.i))).collect(),
        }
    }

    fn farthest(&self, vertex: u32, place: DVec3, full: &impl Fn(u32) -> DVec3) -> f64 {
        let (mut stack, mut most) = (vec![vertex], 0.0f64);
        while let Some(vertex) = stack.pop() {
            match self.children.get(&vertex) {
                Some(children) => stack.extend(children),
                None => most = most.max(place.distance(full(vertex))),
            }
        }
        most
    }
}

#[test]
fn however_vertices_fly_the_front_decides_where_they_are_in_the_end() {
    let seed = 17;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let real = real_meshes_where(|name| ["cow.obj", "fandisk.obj"].contains(&name));
    for (name, mesh) in made_meshes().into_iter().chain(real) {
        let parts = build(&mesh, Some(20));
        let vsps = parts.header.vsps;
        if vsps == 0 {
            continue;
        }
        let leaves = Leaves::new(&parts);
        let places = load(&parts);
        let full = |vertex: u32| places.position(vertex).as_dvec3();
        let mut walk = FrontWalk::new(load(&parts).with_geomorphs(24));
        let (mut flown, mut turned, mut broken, mut checked) = (0, 0, 0, 0);
        for step in 0..4 * vsps {
            let draw = random.next_u32();
            let up = step < vsps || step % 2 == 0;
            let flights = walk.mesh.geomorphs().len();
            match draw % 8 {
                0..=3 if up => {
                    let split = walk.split(&mut || random.next_u32(), |_| true);
                    broken += u32::from(walk.mesh.geomorphs().len() < flights);
                    if split.is_some() && walk.mesh.can_start_geomorph() && draw & 8 == 0 {
                        walk.mesh.start_split_geomorph(&walk.out);
                    }
                }
                0..=1 => {
                    walk.collapse(&mut || random.next_u32());
                    broken += u32::from(walk.mesh.geomorphs().len() < flights);
                }
                2..=4 => {
                    let count = walk.performed.len().max(1);
                    let slot = walk.performed.get(random.next_u32() as usize % count);
                    if let Some(&slot) = slot
                        && walk.mesh.collapse_is_legal(slot)
                        && walk.mesh.can_start_geomorph()
                    {
                        walk.mesh.start_collapse_geomorph(slot);
                    }
                }
                5 => {
                    let count = walk.mesh.geomorphs().len().max(1);
                    let flight = walk
                        .mesh
                        .geomorphs()
                        .get(random.next_u32() as usize % count);
                    if let Some(slot) = flight.and_then(|f| walk.mesh.creator_of_vertex(f.vertex()))
                    {
                        walk.mesh.reverse_geomorphs(slot);
                        turned += 1;
                    }
                }
                _ => flown += fly(&mut walk, f64::from(random.next_u32() % 64) / 63.0),
            }
            undo_arrived(&mut walk);
            for flight in walk.mesh.geomorphs() {
                let vertex = flight.vertex();
                let place = walk.mesh.position(vertex).as_dvec3();
                let bound = f64::from(walk.mesh.radius(vertex));
                // Codes are rounded up, f32 of them here to the nearest.
                let farthest = leaves.farthest(vertex, place, &full);
                assert!(
                    farthest <= bound * (1.0 + 1e-6),
                    "{name}: {farthest} {bound}"
                );
                checked += 1;
            }
            if step % (1 + vsps / 20) == 0 {
                walk.mesh.check();
            }
        }
        while !walk.mesh.geomorphs().is_empty() {
            fly(&mut walk, 1.0);
            undo_arrived(&mut walk);
        }
        println!("{name}: {flown} steps, {turned} turned, {broken} broken off, {checked} bounds");
        let mut fresh = load(&parts);
        let mut out = OperationFaces::new();
        walk.performed.sort_unstable();
        for &i in &walk.performed {
            fresh.split(i, &mut out).unwrap();
        }
        walk.mesh.check();
        assert!(active_faces(&walk.mesh) == active_faces(&fresh), "{name}");
        for vertex in 0..parts.header.base_vertices + 2 * vsps {
            let bits = |mesh: &spm::ActiveMesh| {
                let place = mesh.position(vertex).to_array().map(f32::to_bits);
                (place, mesh.radius(vertex).to_bits())
            };
            assert_eq!(bits(&walk.mesh), bits(&fresh), "{name}: vertex {vertex}");
        }
        assert!(vsps < 100 || flown.min(turned).min(broken) > 10, "{name}");
    }
}

/// Moves every vertex in flight by a share of its way.
fn fly(walk: &mut FrontWalk, share: f64) -> u32 {
    let count = walk.mesh.geomorphs().len();
    for index in 0..count {
        let flight = walk.mesh.geomorphs()[index];
        walk.mesh
            .faces_around_geomorph(&flight, &mut walk.out)
            .unwrap();
        walk.mesh
            .step_geomorph(index, flight.done() + share, &walk.out);
    }
    walk.mesh.finish_geomorphs();
    count as u32
}

/// Undoes the splits whose vertices have come to their parents; one that is needed again turns
/// back.
fn undo_arrived(walk: &mut FrontWalk) {
    let makers = walk.mesh.geomorphs().iter().filter(|f| f.is_to_parent());
    let mut slots: Vec<u32> = makers
        .filter_map(|flight| walk.mesh.creator_of_vertex(flight.vertex()))
        .collect();
    slots.dedup();
    for slot in slots {
        if !walk.mesh.collapse_is_legal(slot) {
            walk.mesh.reverse_geomorphs(slot);
        } else if walk.mesh.has_reached_parent(slot) {
            walk.undo(slot);
        }
    }
}
