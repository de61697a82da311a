//! A probe: its sample, its scripted path, and the limits of its force.

pub(crate) mod contacts;
pub(crate) mod pair;
mod plausibility;
pub(crate) mod proxy_kind;

use crate::bodies::material_motion;
use crate::contact::motion::{Placement, Twist};
use crate::force::effects::{Clock, DeviceSample, Rendered, SceneEffects};
use crate::force::limiter::{ForceLimiter, Passed};
use crate::force::passivity::{CarriedWork, EnergyAccount};
use crate::horizons::Horizons;
use crate::instance::ModelFrame;
use crate::tuning::probe::KEPT_UP;
use geometry::portable::{pow, slerp};
use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{MotionLimits, Sample};
use plausibility::Plausibility;
use protocol::{LONGEST_TOUR_S, TourAsk, TourPoint, tour_points};
use scene::{ProbePlan, ScenePlan, TrajectoryPlan};

/// The tour that a probe's hand is to be led along.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct TourPath {
    /// Object of the scene.
    pub object: u32,
    seed: u64,
    speed_m_per_s: f64,
    depth_m: f64,
    seconds: f64,
    /// Its points in the file's own frame and units, as far as they have arrived.
    #[serde(with = "spm::reserved")]
    pub points: Vec<TourPoint>,
    /// How many have arrived, with those that were of no use.
    taken: u32,
    /// Whether all have.
    pub is_whole: bool,
    /// Tick when the station refused it, if it did: it is requested again after
    /// [`crate::tuning::probe::TOUR_RETRY_S`], or of another station.
    pub refused_at: Option<u64>,
}

impl TourPath {
    /// Whether it is still to come.
    pub fn is_awaited(&self) -> bool {
        !self.is_whole && !self.is_refused()
    }

    /// How many points have arrived.
    pub fn taken(&self) -> u64 {
        self.taken.into()
    }

    /// Takes the points of a chunk, of which the first has this index; false where points before it
    /// are missing. What came before is there: an epoch or a station that begins goes on with it.
    pub fn take(&mut self, first: u32, points: &[TourPoint]) -> bool {
        let Some(known) = self.taken.checked_sub(first) else {
            return false;
        };
        for point in points.iter().skip(known as usize) {
            self.taken += 1;
            let finite = point.t.is_finite()
                && point.position.iter().all(|x| x.is_finite())
                && point.orientation_wxyz.iter().all(|x| x.is_finite());
            let ordered = self.points.last().is_none_or(|last| last.t < point.t);
            // A longer path than was requested is cut.
            if finite && ordered && self.points.len() < self.points.capacity() {
                self.points.push(*point);
            }
        }
        true
    }

    /// Counts points from now on and keeps none.
    pub fn drop_points(&mut self) {
        self.points = Vec::new();
    }

    /// Whether the station cannot make it.
    pub fn is_refused(&self) -> bool {
        self.refused_at.is_some()
    }
}

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Probe {
    /// Radius of the ball around its position that reaches as deep as its tip, metres.
    tip_m: f64,
    /// Largest distance of its shape from its position, metres.
    pub reach_m: f64,
    /// The tour, if it is on one.
    pub tour: Option<TourPath>,
    /// The pose of this tick: the sample, or where it was last; world, metres.
    pub pose: Option<Pose>,
    /// Where it was in the tick before.
    pub last: Option<Pose>,
    /// Largest displacement in one of the last ticks, metres, of those that were kept up.
    pub speed: f64,
    /// The farthest motion of a point a period, metres, by the last samples.
    moves: [f64; KEPT_UP],
    /// Motion a period by the last two samples, and velocity (m/s) for the effects of the scene:
    /// where a sample is missing it goes on, as long as the force does.
    motion_a_period: Twist,
    velocity: DVec3,
    /// Periods from the pose of the tick before to that of this tick: more than 1 where samples
    /// were missing or periods were skipped.
    periods: u64,
    /// Periods since the tick before.
    elapsed: u64,
    /// Whether the device went to zero by itself in them.
    was_cut: bool,
    plausibility: Plausibility,
    /// Times of the last accepted sample and of the last rejected one, ns; 0 where it had none.
    judged_ns: [u64; 2],
    /// Whether this tick's sample was rejected.
    pub rejected: bool,
    /// Samples rejected so far.
    pub rejected_samples: u64,
    /// Limited wrench of this tick.
    pub wrench: Wrench,
    /// Whether it was cut.
    pub clamped: bool,
    pub energy: EnergyAccount,
    /// Work of the last wrench over the motion of the material, joules: of all of it, and of what
    /// is limited.
    pub carried: [f64; 2],
    /// Whether the account limits the force.
    passivity: bool,
    /// Effects of the scene that act anywhere.
    pub effects: SceneEffects,
    limiter: ForceLimiter,
    /// Whether its device renders torque.
    pub renders_torque: bool,
    horizons: Horizons,
    /// Periods since the last accepted sample.
    silence: u64,
    /// Whether the last sample that could tell said that a hand holds the device.
    is_held: bool,
}

impl Probe {
    /// Everything allocated now; `device_max_n` is what its device can render, `tour_seconds` how
    /// long a tour is.
    pub fn new(plan: &ScenePlan, probe: &ProbePlan, device_max_n: f64, tour_seconds: f64) -> Self {
        let tour = match probe.trajectory {
            TrajectoryPlan::Tour {
                object,
                seed,
                speed_m_per_s,
                depth_m,
            } => Some(TourPath {
                object: object as u32,
                seed,
                speed_m_per_s,
                depth_m,
                seconds: tour_seconds,
                points: Vec::with_capacity(path_capacity(tour_seconds)),
                taken: 0,
                is_whole: false,
                refused_at: None,
            }),
            TrajectoryPlan::Points(_) => None,
        };
        let limiter = ForceLimiter::new(plan.safety, device_max_n, plan.loop_.rate_hz);
        Self {
            tip_m: probe.shape.tip_m(),
            reach_m: probe.shape.extent_m(),
            tour,
            pose: None,
            last: None,
            speed: 0.0,
            moves: [0.0; KEPT_UP],
            motion_a_period: Twist::default(),
            velocity: DVec3::ZERO,
            periods: 1,
            elapsed: 1,
            was_cut: false,
            plausibility: Plausibility::new(
                MotionLimits::UNLIMITED,
                probe.device.encoder_m,
                1.0 / plan.loop_.rate_hz,
            )
            .with_angular_step(probe.device.rotation.map_or(0.0, |of| of.encoder_rad)),
            judged_ns: [0; 2],
            rejected: false,
            rejected_samples: 0,
            wrench: Wrench::ZERO,
            clamped: false,
            energy: EnergyAccount::new(probe.device.encoder_m, 1.0 / plan.loop_.rate_hz)
                .with_angular_step(probe.device.rotation.map_or(0.0, |of| of.encoder_rad))
                .with_slew(limiter.most_changes()),
            carried: [0.0; 2],
            passivity: plan.safety.passivity,
            effects: SceneEffects::new(&plan.effects),
            limiter,
            renders_torque: true,
            horizons: Horizons::new(plan.loop_.rate_hz),
            silence: 0,
            is_held: true,
        }
    }

    /// Judges the samples by these limits from now on.
    pub fn set_motion_limits(&mut self, limits: MotionLimits) {
        self.plausibility.set_limits(limits);
    }

    /// Takes the sample of a tick, `elapsed` periods after the tick before, if it is plausible,
    /// else stays where it was. Whether a hand holds the device is believed of any sample. One of
    /// the same time as the last accepted one, or the last rejected one, is none: a driver that
    /// exchanges the newest values with its own thread gives it again where it has no newer one.
    pub fn sample(&mut self, given: Option<Sample>, elapsed: u64) {
        if let Some(in_hand) = given.and_then(|sample| sample.in_hand) {
            self.is_held = in_hand;
        }
        let given = given.filter(|of| of.time_ns == 0 || !self.judged_ns.contains(&of.time_ns));
        let pose = given.map(|sample| sample.pose);
        let is_free = self.limiter.is_closed();
        let accepted = self.plausibility.judge(pose, elapsed, is_free);
        self.rejected = given.is_some() && accepted.is_none();
        if let Some(sample) = given {
            self.judged_ns[usize::from(self.rejected)] = sample.time_ns;
        }
        self.rejected_samples += u64::from(self.rejected);
        self.elapsed = elapsed;
        self.periods = elapsed;
        if let Some(accepted) = accepted {
            self.silence = 0;
            self.pose = Some(accepted.pose);
            self.periods = accepted.periods;
            if accepted.is_new_place {
                // It did not move there.
                self.last = None;
                self.energy.go_to_new_place();
                self.effects.go_to_new_place();
            }
            let motion = self.motion();
            let periods = self.periods as f64;
            self.motion_a_period = Twist {
                linear: motion.linear / periods,
                angular: motion.angular / periods,
            };
            self.moves.rotate_right(1);
            self.moves[0] = self.motion_a_period.farthest(self.reach_m);
        } else {
            self.silence = self.silence.saturating_add(elapsed);
            self.pose = self.last;
            if self.silence > self.horizons.max_silence {
                self.motion_a_period = Twist::default();
                self.moves = [0.0; KEPT_UP];
            }
        }
        if !self.was_cut {
            self.see_motion();
        }
        let kept_up = self.moves.into_iter().fold(f64::INFINITY, f64::min);
        let left = pow(self.horizons.speed_left, elapsed as f64);
        self.speed = kept_up.max(left * self.speed);
    }

    /// Shows the account the pose of this tick, or that the device goes on without one.
    fn see_motion(&mut self) {
        let Some(pose) = self.pose else {
            return;
        };
        if self.goes_on() {
            self.energy.see_nothing(self.elapsed);
        } else {
            self.energy.see(&pose, self.periods());
        }
    }

    /// Whether this tick has no sample, and its device is taken to go on as it did: as long as the
    /// force does.
    pub fn goes_on(&self) -> bool {
        0 < self.silence && self.silence <= self.horizons.max_silence
    }

    /// Whether the device has moved without its wrench since the tick before, or to another place.
    pub fn was_interrupted(&self) -> bool {
        self.was_cut || self.last.is_none()
    }

    /// Periods since the tick before, and those from the pose of that tick to that of this one.
    pub fn periods(&self) -> [u64; 2] {
        [self.elapsed, self.periods]
    }

    /// How it has moved since the tick before, metres and radians, world.
    pub fn motion(&self) -> Twist {
        match (self.last, self.pose) {
            (Some(last), Some(pose)) => placement(&last).to(&placement(&pose)),
            _ => Twist::default(),
        }
    }

    /// The same along the material of an object whose pose was another in the tick before; and its
    /// motion along it in a period, estimated without the noise of the encoder: a step of it in one
    /// period, 40 mm/s at 10 um and 4 kHz, would be felt in a damper.
    pub fn motion_along(&self, before: Option<&Pose>, now: &Pose) -> [Twist; 2] {
        let a_period = if self.was_cut || self.silence > self.horizons.max_silence {
            // The account divides what the device did with and without the wrench.
            self.motion_a_period
        } else {
            Twist {
                linear: self.energy.motion(),
                angular: self.energy.turn(),
            }
        };
        let motion = self.motion();
        let (Some(before), Some(pose)) = (before, &self.pose) else {
            return [motion, a_period];
        };
        let carried = material_motion(before, now, pose.position);
        let carried_a_period = carried.times(1.0 / self.elapsed as f64);
        [motion.minus(&carried), a_period.minus(&carried_a_period)]
    }

    /// Passes what all touches, and the scene, want through energy account and force limiter to the
    /// device. `ahead`: the work of what passive over the motion of the material in the coming
    /// period. What has passed of what is passive, and of what drives.
    pub fn limit(
        &mut self,
        clock: Clock,
        mut wanted: Rendered,
        mut ahead: CarriedWork,
        is_open: bool,
    ) -> [Passed; 2] {
        self.render_effects(clock, &mut wanted);
        if !self.renders_torque {
            // It does no work then.
            wanted.passive = wanted.passive.without_torque();
            wanted.active = wanted.active.without_torque();
            ahead.turned_j = 0.0;
        }
        let mut passive = wanted.passive;
        let mut given = 1.0;
        if self.passivity {
            given = self.energy.share(passive, wanted.spring, ahead);
            passive = passive * given;
        }
        let open = is_open && self.is_held && self.silence <= self.horizons.max_silence;
        let is_driven = wanted.active != Wrench::ZERO;
        let sum = if is_driven {
            passive + wanted.active
        } else {
            passive
        };
        let output = self.limiter.pass(sum, open, self.elapsed);
        (self.wrench, self.clamped) = (output.wrench, output.clamped);
        let mut passed = Passed::of(&sum, &output.wrench);
        if !self.renders_torque {
            passed.torque = 0.0;
        }
        // What lingers of a force that was limited stays limited beside an active one, and what
        // lingers of an active one stays active.
        let [before, limited_before] = self.energy.output();
        let limited = if is_driven || limited_before != before {
            // Nothing has passed of a sum that is not finite.
            let part = if sum.is_finite() {
                passive
            } else {
                Wrench::ZERO
            };
            output.part_of(&limited_before, &part)
        } else {
            output.wrench
        };
        self.energy.set_output(output.wrench, limited);
        [passed.times(given), passed]
    }

    /// Books the motion of this tick, and adds the effects of the scene to what is wanted.
    fn render_effects(&mut self, clock: Clock, wanted: &mut Rendered) {
        let Some(pose) = self.pose else {
            return;
        };
        let before = self.last.unwrap_or(pose);
        let was_cut = self.was_cut;
        self.book_motion(&pose);
        self.last = Some(pose);
        self.velocity = match self.silence {
            // The account divides what the device did with and without the wrench.
            0 if was_cut => self.motion_a_period.linear / clock.period_s,
            0 => self.energy.motion() / clock.period_s,
            silence if silence > self.horizons.max_silence => DVec3::ZERO,
            _ => self.velocity,
        };
        let seconds = self.elapsed as f64 * clock.period_s;
        self.energy.pass_time(seconds);
        if !self.effects.is_empty() {
            let device = DeviceSample {
                pose: &pose,
                velocity: self.velocity,
                displacement: pose.position - before.position,
                elapsed: self.elapsed,
            };
            self.effects.render(clock, &device, wanted);
        }
    }

    /// Books the work of the last wrench up to this tick, over the motion that [`Self::sample`]
    /// saw. A wrench that has expired meanwhile has done work as long as it was valid: under it the
    /// device went on as before.
    fn book_motion(&mut self, pose: &Pose) {
        let carried = std::mem::take(&mut self.carried);
        if !std::mem::take(&mut self.was_cut) {
            self.energy.book(carried);
            return;
        }
        let valid = self.horizons.validity;
        if self.elapsed == valid {
            self.see_motion();
            self.energy.book(carried);
            self.energy.set_output(Wrench::ZERO, Wrench::ZERO);
            return;
        }
        let expired = self.last.filter(|_| self.elapsed > valid);
        if let Some(last) = expired {
            let share = valid as f64 / self.elapsed as f64;
            let expired_at = Pose {
                position: last.position + self.energy.motion() * valid as f64,
                orientation: slerp(last.orientation, pose.orientation, share),
            };
            self.energy.moved_to(&expired_at, [valid; 2], carried);
        }
        // What the hand put into the contact is no credit any more.
        self.energy.set_output(Wrench::ZERO, Wrench::ZERO);
        if expired.is_some() {
            let rest = self.elapsed - valid;
            self.energy.moved_to(pose, [rest; 2], [0.0; 2]);
        } else {
            self.see_motion();
            self.energy.book(carried);
        }
    }

    /// Its device went to zero by itself since the last tick, or before the last wrench reached it:
    /// the next wrench rises from zero.
    pub fn force_was_cut(&mut self) {
        self.limiter.close();
        self.was_cut = true;
    }

    /// Whether its force has ramped down.
    pub fn is_at_rest(&self) -> bool {
        self.limiter.is_closed()
    }

    /// The tour to ask for, in the units of the object's model.
    pub fn tour_ask(&self, frame: &ModelFrame) -> Option<TourAsk> {
        let tour = self.tour.as_ref()?;
        let scale = frame.metres_per_unit;
        Some(TourAsk {
            seed: tour.seed,
            seconds: tour.seconds,
            speed: tour.speed_m_per_s / scale,
            depth: tour.depth_m / scale,
            radius: self.tip_m / scale,
            from: tour.taken(),
        })
    }

    /// Whether the station cannot make its tour.
    pub fn is_tour_refused(&self) -> bool {
        self.tour.as_ref().is_some_and(TourPath::is_refused)
    }

    /// Requests a refused tour again after a while, or of another station.
    pub fn retry_tour(&mut self, tick: u64, is_another_station: bool) {
        let Some(tour) = &mut self.tour else {
            return;
        };
        let waits = |at: u64| !is_another_station && tick < at + self.horizons.tour_retry;
        tour.refused_at = tour.refused_at.filter(|&at| waits(at));
    }

    /// Whether a tour of an object is still to come.
    pub fn awaits_tour_of(&self, object: u32) -> bool {
        let tour = self.tour.as_ref();
        tour.is_some_and(|tour| tour.object == object && tour.is_awaited())
    }
}

fn placement(pose: &Pose) -> Placement {
    Placement {
        centre: pose.position,
        orientation: pose.orientation,
    }
}

/// Points that a tour of some seconds has.
fn path_capacity(seconds: f64) -> usize {
    tour_points(if seconds > 0.0 {
        seconds.min(LONGEST_TOUR_S)
    } else {
        0.0
    }) as usize
}

#[cfg(test)]
mod tests;
