//! A local front as the two processes form it: the station's collection finds the closures of the
//! wanted cells, the controller's cache loads, splits and collapses.

use crate::failure::Failure;
use crate::models::Model;
use glam::DVec3;
use hrtc_core::cache::{AfterUnload, Cache, LoadError, RegionKey};
use spm::{OperationFaces, RegionId};
use station_core::collection::{RegionAt, closure};
use std::collections::BTreeSet;

/// Cache bytes for each VSP of the model: enough for all of them, and for the lists of any block of
/// regions.
const BYTES_A_VSP: usize = 700;
/// The most of it, for models of millions of faces.
const MAX_BYTES: usize = 256 << 20;

/// A part of a batch of splits or collapses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BatchPart {
    /// One split or collapse.
    Operation,
    /// The update of the tree for all of them.
    Refit,
}

/// Told of the parts of a batch, to time them.
pub trait BatchObserver {
    /// A part may begin; it ends, or another one begins.
    fn begins(&mut self) {}
    /// The part that began last has ended.
    fn ended(&mut self, _: BatchPart) {}
}

/// Observes nothing.
impl BatchObserver for () {}

/// A cache with one model, and the collection that serves it.
pub struct LocalFront<'a> {
    model: &'a Model,
    cache: Cache,
    wanted: BTreeSet<RegionKey>,
    out: OperationFaces,
}

impl<'a> LocalFront<'a> {
    /// The base mesh, and room for the whole model if it is not too large for that.
    ///
    /// # Errors
    /// When the base mesh does not fit.
    pub fn new(model: &'a Model) -> Result<Self, Failure> {
        let header = model.file.model_header();
        let base = header.base_faces.max(header.base_vertices);
        Self::with_slots(model, base + header.vsps)
    }

    /// The base mesh, and room for about so many base faces and VSPs.
    ///
    /// # Errors
    /// When the base mesh does not fit.
    pub fn with_slots(model: &'a Model, slots: u32) -> Result<Self, Failure> {
        let failed = |what: String| Failure::Run(format!("{}: {what}", model.name));
        let header = model.file.model_header();
        let bytes = (slots as usize * BYTES_A_VSP + (1 << 18)).min(MAX_BYTES);
        let mut cache = Cache::new(bytes);
        cache
            .begin_model(&header)
            .map_err(|error| failed(error.to_string()))?;
        let set = (0u32..)
            .zip(model.file.base_vertices())
            .all(|(k, v)| cache.set_base_vertex(k, v))
            && (0u32..)
                .zip(model.file.base_faces())
                .all(|(k, f)| cache.set_base_face(k, f));
        if !set {
            return Err(failed("its base mesh is refused".to_string()));
        }
        cache.refit();
        Ok(Self {
            model,
            cache,
            wanted: BTreeSet::new(),
            out: OperationFaces::new(),
        })
    }

    /// The cache.
    #[must_use]
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// The cells within a distance of a point.
    #[must_use]
    pub fn cells_near(&self, point: DVec3, tolerance: f32, distance: f64) -> Vec<RegionKey> {
        let grid = self.model.file.model_header().grid_of(tolerance);
        let mut cells = Vec::new();
        if let Some((low, high)) = grid.cell_range(point - distance, point + distance) {
            for z in low.z..=high.z {
                for y in low.y..=high.y {
                    for x in low.x..=high.x {
                        let id = RegionId::of_cell(glam::UVec3::new(x, y, z));
                        if grid.distance_squared(id, point) <= distance * distance {
                            cells.push(RegionKey::new(id, tolerance));
                        }
                    }
                }
            }
        }
        cells
    }

    /// Makes these the wanted regions: loads what is missing, marks the rest to be undone. Splits
    /// and collapses nothing yet.
    ///
    /// # Errors
    /// When a region cannot be collected or does not fit.
    pub fn want(&mut self, cells: &[RegionKey]) -> Result<(), Failure> {
        let cells: BTreeSet<RegionKey> = cells.iter().copied().collect();
        for &key in self.wanted.difference(&cells) {
            if let Some(region) = self.cache.regions.index(key) {
                self.cache.set_wanted(region, false, u32::MAX);
            }
        }
        let added: Vec<RegionKey> = cells.difference(&self.wanted).copied().collect();
        for key in added {
            let region = match self.cache.regions.index(key) {
                Some(region) => region,
                None => self.load(key)?,
            };
            self.cache.set_wanted(region, true, u32::MAX);
        }
        self.wanted = cells;
        Ok(())
    }

    fn load(&mut self, key: RegionKey) -> Result<usize, Failure> {
        // The same two numbers on both sides of the wire.
        let asked = RegionAt {
            region: key.id,
            tolerance_bits: key.tolerance_bits,
        };
        let failed = |what: &dyn std::fmt::Debug| {
            Failure::Run(format!(
                "{}: {asked} cannot be loaded: {what:?}",
                self.model.name
            ))
        };
        let closure = closure(&self.model.file, asked).map_err(|error| failed(&error))?;
        self.make_room(closure.len());
        let region = self.cache.regions.request(key);
        let region = region.ok_or_else(|| failed(&"the table is full"))?;
        let mut take = || {
            // Every record comes; those that are here already are passed over.
            for &i in &closure {
                self.cache.add_to_closure(region, i, true)?;
            }
            for &i in &closure {
                let record = &self.model.records[i as usize];
                let load = |cache: &mut Cache| cache.load(region, record, &mut { u32::MAX });
                let mut loaded = load(&mut self.cache);
                // What is performed and wanted no more makes room, one at a time, as in the
                // controller.
                while loaded == Err(LoadError::NoRoom) && self.cache.collapse_oldest(&mut self.out)
                {
                    loaded = load(&mut self.cache);
                }
                loaded?;
            }
            self.cache.end_answer(region)
        };
        take().map_err(|error| failed(&error))?;
        Ok(region)
    }

    /// Lets go of regions that nobody wants when so many records may not fit.
    fn make_room(&mut self, records: usize) {
        let free = self.cache.slots() - self.cache.loaded();
        if !self.cache.is_nearly_full() && free as usize >= records {
            return;
        }
        let idle: Vec<usize> = self
            .cache
            .regions
            .indices()
            .filter(|&k| {
                let region = self.cache.regions.at(k);
                region.is_resident() && !region.wanted
            })
            .collect();
        for region in idle {
            self.cache.begin_unload(region, AfterUnload::Forget, 0);
        }
        self.cache.go_on_unloading(&mut { u32::MAX });
    }

    /// Performs up to `most` splits of wanted regions, and refits; how many there were.
    ///
    /// # Errors
    /// When a record does not fit the mesh.
    pub fn split_some(&mut self, most: u32) -> Result<u32, Failure> {
        self.split_observed(most, &mut ())
    }

    /// The same, observed.
    ///
    /// # Errors
    /// When a record does not fit the mesh.
    pub fn split_observed(
        &mut self,
        most: u32,
        observer: &mut impl BatchObserver,
    ) -> Result<u32, Failure> {
        let mut done = 0;
        for &key in &self.wanted {
            let Some(region) = self.cache.regions.index(key) else {
                continue;
            };
            while done < most {
                observer.begins();
                let mut entries = u32::MAX;
                let Some(slot) = self.cache.next_split(region, &mut entries) else {
                    break;
                };
                self.cache
                    .split(slot, &mut self.out)
                    .map_err(|error| Failure::Run(format!("{}: {error}", self.model.name)))?;
                observer.ended(BatchPart::Operation);
                done += 1;
            }
        }
        self.refit(done, observer);
        Ok(done)
    }

    fn refit(&mut self, done: u32, observer: &mut impl BatchObserver) {
        if done > 0 {
            observer.begins();
            self.cache.refit();
            observer.ended(BatchPart::Refit);
        }
    }

    /// Undoes up to `most` splits that no wanted region needs, and refits; how many there were.
    pub fn collapse_some(&mut self, most: u32) -> u32 {
        self.collapse_observed(most, &mut ())
    }

    /// The same, observed.
    pub fn collapse_observed(&mut self, most: u32, observer: &mut impl BatchObserver) -> u32 {
        let mut done = 0;
        while done < most {
            observer.begins();
            if !self.cache.collapse_oldest(&mut self.out) {
                break;
            }
            observer.ended(BatchPart::Operation);
            done += 1;
        }
        self.refit(done, observer);
        done
    }

    /// Splits and collapses until the front is that of the wanted regions.
    ///
    /// # Errors
    /// When a record does not fit the mesh.
    pub fn settle(&mut self) -> Result<(), Failure> {
        self.split_some(u32::MAX)?;
        self.collapse_some(u32::MAX);
        Ok(())
    }

    /// Ids of the performed VSPs, ascending.
    #[must_use]
    pub fn performed(&self) -> Vec<u32> {
        let mesh = self.cache.mesh();
        let slots = (0..self.cache.slots()).filter(|&slot| mesh.is_performed(slot));
        let mut ids: Vec<u32> = slots.map(|slot| mesh.id(slot)).collect();
        ids.sort_unstable();
        ids
    }
}
