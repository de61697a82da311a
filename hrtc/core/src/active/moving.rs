//! Objects that move: everything that knows where an object is learns its pose of this tick here, before anything
//! looks.

use crate::active::active_set::{place, seat_of};
use crate::bodies::{Extent, Movables, material_motion};
use crate::contact::motion::Twist;
use crate::controller::Controller;
use glam::DVec3;

impl Controller {
    /// What moves, and where it is.
    #[must_use]
    pub fn movables(&self) -> &Movables {
        &self.movables
    }

    /// How the material of an object at a place (world, metres) has moved in the last tick, metres and radians; nothing
    /// of what stands.
    #[must_use]
    pub fn carried(&self, object: usize, at: DVec3) -> Twist {
        let body = self.movables.body(object as u32);
        let motion = body.and_then(|body| Some(material_motion(&body.before()?, &body.pose(), at)));
        motion.unwrap_or_default()
    }

    /// Takes the objects that move to where they are in this tick, and the work that the last forces did over their
    /// motion to the probes' accounts. Of a scene in which everything stands it does nothing.
    pub(crate) fn move_objects(&mut self, tick: u64) {
        if self.movables.is_empty() {
            return;
        }
        let Self {
            movables,
            placings,
            library,
            seats,
            broad_phase,
            ..
        } = self;
        movables.set_extent(|object| {
            let placing = &placings[object as usize];
            let header = &library.model(placing.model)?.header;
            let frame = crate::frame::ModelFrame::new(placing.pose, placing.scale, header);
            Extent::new(header, frame.metres_per_unit)
        });
        movables.step(tick);
        for (object, body) in movables.moved() {
            let placing = &mut placings[object as usize];
            placing.pose = body.pose();
            placing.before = body.before();
            if let Some(model) = library.model(placing.model) {
                place(broad_phase, placing, model);
            }
            if let Some(seat) = seat_of(seats, object) {
                seat.move_to(placing.pose, placing.before);
            }
        }
        let awake = movables.moved();
        broad_phase
            .set_ways(awake.map(|(object, body)| (object as usize, body.max_displacement())));
        for (k, probe) in self.probes.iter_mut().enumerate() {
            let work = self.movables.take_carried_work(k);
            for (sum, work) in probe.carried.iter_mut().zip(work) {
                *sum += work;
            }
        }
    }
}
