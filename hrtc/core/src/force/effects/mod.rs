//! Haptic effects of a scene beyond the stiffness and damping of its surfaces, one file each.
//!
//! | effect | content | belongs to |
//! |---|---|---|
//! | [`friction`] | dry friction, static and dynamic | a surface |
//! | [`shading`] | smooth force direction over edges | a surface |
//! | [`texture`] | relief finer than the mesh | a surface |
//! | [`magnet`] | attraction to a surface | a surface |
//! | [`vibration`] | a sine | a surface in contact, or the scene |
//! | [`viscosity`] | drag | the scene |
//! | [`spring`] | a spring to a point or a path | the scene |
//! | [`gravity`] | the weight of the tool | the scene |
//! | [`inertia`] | a mass that the device carries | the scene |
//! | [`boundary`] | the limits of the workspace | the scene |
//!
//! Only the effects that a scene lists exist: [`SurfaceEffects`] for each probe and object,
//! [`SceneEffects`] for each probe. Any other has no state, no call, and no influence on a bit of
//! the force. State belongs to the pair of probe and object. Phases count ticks.
//!
//! Friction, shading and texture act at each contact with its own force: [`contact_set`].
//!
//! Passive effects (friction, shading, texture, boundary) are limited by the energy account,
//! together with the force of the surface. Active effects (all others) are not: they may put out
//! energy. The crate `scene` checks their stability, and the force limiter bounds the sum.

pub mod boundary;
pub mod contact_set;
pub mod free_space;
pub mod friction;
pub mod gravity;
pub mod inertia;
pub mod magnet;
mod nearest_faces;
pub mod shading;
pub mod spring;
pub mod texture;
pub mod vibration;
pub mod viscosity;

use crate::contact::motion::Twist;
use crate::contact::query::{Surface, Work};
use crate::force::passivity::{CouplingSpring, EnergyAccount};
use crate::tuning::force::MAX_SHADING_FACES;
use contact_set::{ContactSet, MAX_CONTACTS, Push};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use mutants::{Mutant, is};
use scene::{Effect, EffectPlan};

/// Time of a tick.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    /// Index of the tick.
    pub tick: u64,
    /// Seconds a tick.
    pub period_s: f64,
}

/// A probe in contact with a surface.
///
/// Vectors are in the object's axes; places are in metres from the origin of its stored
/// coordinates.
#[derive(Debug, Clone, Copy)]
pub struct ContactSample<'a> {
    /// Nodes and faces that the searches of the effects may visit.
    pub max_work: u32,
    /// The tick.
    pub clock: Clock,
    /// Periods since the tick before, and those of the probe's motion: see `EnergyAccount::see`.
    pub periods: [u64; 2],
    /// Whether there was no sample of the device, which is taken to go on as it did.
    pub goes_on: bool,
    /// Whether the device has moved without its wrench since the tick before, or to another place.
    pub is_interrupted: bool,
    /// The surface, in the model's units.
    pub surface: Surface<'a>,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// Origin of the stored coordinates in the model's own, metres.
    pub origin: DVec3,
    /// Rotation from the object's axes to the world's.
    pub to_world: DQuat,
    /// Contact point on the surface; of a tool, where it is pushed most.
    pub point: DVec3,
    /// Middle of a ball proxy; a tool has none.
    pub middle: Option<DVec3>,
    /// Contacts that push a tool. None for a ball, which has one with all of its force, and for a
    /// tool that is held though nothing touches it.
    pub pushes: &'a [Push],
    /// Radius of gyration of a tool; 0 for a ball.
    pub gyration_m: f64,
    /// The device.
    pub device: Pose,
    /// Pose of the proxy.
    pub proxy: Pose,
    /// Velocity of the probe relative to the object, m/s.
    pub velocity: DVec3,
    /// Its angular velocity relative to the object, rad/s.
    pub angular: DVec3,
    /// How it moved in a period by the samples, metres and radians: the velocities are estimated.
    pub moved: Twist,
    /// Stiffness of the surface, N/m.
    pub stiffness_n_per_m: f64,
    /// That of it which its spring has now: less where a contact that was found late is paid for.
    pub paid_n_per_m: f64,
    /// Force of the surface's spring over the whole force of the surface, with damping.
    pub undamped: f64,
}

impl ContactSample<'_> {
    /// Velocity of the probe at a lever arm, m/s.
    #[must_use]
    pub fn velocity_at(&self, arm: DVec3) -> DVec3 {
        self.velocity + self.angular.cross(arm)
    }
}

/// A device in a tick; world, metres.
#[derive(Debug, Clone, Copy)]
pub struct DeviceSample<'a> {
    /// Its pose.
    pub pose: &'a Pose,
    /// Its velocity, m/s.
    pub velocity: DVec3,
    /// Its displacement since the tick before; zero without a sample.
    pub displacement: DVec3,
    /// Periods since the last call.
    pub elapsed: u64,
}

/// The wrench so far, passive and active.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Rendered {
    /// Passive wrench; the energy account limits it.
    pub passive: Wrench,
    /// Springs behind the passive wrench.
    pub spring: CouplingSpring,
    /// Active wrench; it may put out energy.
    pub active: Wrench,
}

impl Rendered {
    /// The passive wrench of a surface alone.
    #[must_use]
    pub fn new(passive: Wrench, spring: CouplingSpring) -> Self {
        Self {
            passive,
            spring,
            active: Wrench::ZERO,
        }
    }

    /// Both wrenches, rotated.
    #[must_use]
    pub fn turned(self, turn: DQuat) -> Self {
        let turned = |wrench: Wrench| Wrench {
            force: turn * wrench.force,
            torque: turn * wrench.torque,
        };
        Self {
            passive: turned(self.passive),
            spring: self.spring,
            active: turned(self.active),
        }
    }

    /// Adds a force (newtons) to the passive wrench, and its torque with a lever arm (metres) from
    /// the reference point.
    pub fn add_passive(&mut self, force: DVec3, arm: DVec3) {
        self.passive.force += force;
        self.passive.torque += arm.cross(force);
    }
}

impl std::ops::Add for Rendered {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            passive: self.passive + other.passive,
            spring: self.spring + other.spring,
            active: self.active + other.active,
        }
    }
}

/// Time during which an effect acts, and its fades, seconds.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
struct Switch {
    /// Start of the fade-in; 0 for no fade-in.
    from: f64,
    /// Start of the fade-out.
    until: f64,
    /// Duration of a fade.
    fade: f64,
}

impl Switch {
    /// Amplitude of the effect in a tick, 0 to 1.
    fn amount(&self, clock: Clock) -> f64 {
        let now = clock.tick as f64 * clock.period_s;
        // At the start of a run the ramp of the force limiter fades in.
        let rising = if self.from == 0.0 {
            1.0
        } else {
            (now - self.from) / self.fade
        };
        let falling = 1.0 - (now - self.until) / self.fade;
        let amount = rising.min(falling).clamp(0.0, 1.0);
        if is(Mutant::Switch) {
            amount.ceil()
        } else {
            amount
        }
    }
}

/// An effect of a scene.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Listed<E> {
    effect: E,
    kind: usize,
    switch: Switch,
    calls: u64,
}

impl<E> Listed<E> {
    fn new(plan: &EffectPlan, effect: E) -> Self {
        Self {
            effect,
            kind: plan.effect.index(),
            switch: Switch {
                from: plan.from_s,
                until: plan.until_s,
                fade: plan.fade_s,
            },
            calls: 0,
        }
    }

    /// The effect and its amplitude in a tick, 0 to 1; `None` while it does not act.
    fn called(&mut self, clock: Clock) -> Option<(&mut E, f64)> {
        let amount = self.switch.amount(clock);
        (amount > 0.0 || is(Mutant::Unlisted)).then(|| {
            self.calls += 1;
            (&mut self.effect, amount)
        })
    }
}

/// Cost of the effects of one kind, the evidence that unlisted effects cost nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Usage {
    /// Number of calls.
    pub calls: u64,
    /// Bytes of their state.
    pub bytes: usize,
    /// Searches of shading that found more faces than there is room for.
    pub cut: u64,
}

/// Usage of every kind, in the order of [`Effect::NAMES`].
pub type UsageByKind = [Usage; Effect::NAMES.len()];

fn add_usage<E>(listed: &[Listed<E>], usage: &mut UsageByKind) {
    for effect in listed {
        usage[effect.kind].calls += effect.calls;
        usage[effect.kind].bytes += size_of_val(effect);
    }
}

#[derive(Debug, Clone)]
#[expect(
    clippy::large_enum_variant,
    reason = "a box would be allocated in the tick that activates an object"
)]
#[derive(serde::Serialize, serde::Deserialize)]
enum SurfaceEffect {
    Friction(friction::Friction),
    Shading(shading::Shading),
    Texture(texture::Texture),
    Magnet(magnet::Magnet),
    Vibration(vibration::Vibration),
}

/// Effects of a surface on one probe, in the order of their application.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct SurfaceEffects {
    #[serde(with = "spm::reserved")]
    listed: Vec<Listed<SurfaceEffect>>,
    contacts: ContactSet,
    /// An empty energy account of the device; `None` without an energy limit.
    account: Option<EnergyAccount>,
}

impl SurfaceEffects {
    /// No effects, and room for `most`. `account`: an empty one of the device; `None` without an
    /// energy limit.
    #[must_use]
    pub fn with_room(most: usize, account: Option<EnergyAccount>) -> Self {
        Self {
            listed: Vec::with_capacity(most),
            contacts: ContactSet::default(),
            account,
        }
    }

    /// Replaces the effects by those of another object. It does not allocate.
    ///
    /// # Panics
    /// When there is no room for all.
    pub fn assign(&mut self, plans: &[EffectPlan]) {
        assert!(
            plans.len() <= self.listed.capacity(),
            "room was made for all"
        );
        let account = &self.account;
        self.contacts.reset();
        self.listed.clear();
        self.listed.extend(plans.iter().filter_map(|plan| {
            let effect = match &plan.effect {
                Effect::Friction(of) => {
                    SurfaceEffect::Friction(friction::Friction::new(*of, account.clone()))
                }
                Effect::Shading(of) => SurfaceEffect::Shading(shading::Shading::new(*of)),
                Effect::Texture(of) => SurfaceEffect::Texture(texture::Texture::new(of.clone())),
                Effect::Magnet(of) => SurfaceEffect::Magnet(magnet::Magnet::new(*of)),
                Effect::Vibration(of) => SurfaceEffect::Vibration(vibration::Vibration::new(*of)),
                _ => return None,
            };
            Some(Listed::new(plan, effect))
        }));
    }

    /// Whether there is no effect.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.listed.is_empty()
    }

    /// Applies the effects to the wrench of a contact.
    pub fn render_contact(&mut self, at: &ContactSample<'_>, out: &mut Rendered, work: &mut Work) {
        let mut contacts = self.contacts.track(at, out.passive.force);
        let contacts = contacts.all();
        // A magnet acts only without contact.
        let is_called =
            |listed: &&mut Listed<_>| !matches!(listed.effect, SurfaceEffect::Magnet(_));
        for listed in self.listed.iter_mut().filter(is_called) {
            let Some((effect, amount)) = listed.called(at.clock) else {
                continue;
            };
            match effect {
                SurfaceEffect::Friction(of) => of.render(at, contacts, amount, out),
                SurfaceEffect::Shading(of) => work.add(of.turn(at, contacts, amount, out)),
                SurfaceEffect::Texture(of) => of.raise(at, contacts, amount, out),
                SurfaceEffect::Vibration(vibration) => {
                    let force = vibration.force(at.clock) * amount;
                    out.active.force += at.to_world.conjugate() * force;
                }
                SurfaceEffect::Magnet(_) => {}
            }
        }
    }

    /// Adds the calls and bytes of each kind to `usage`.
    pub fn add_usage(&self, usage: &mut UsageByKind) {
        add_usage(&self.listed, usage);
        for listed in &self.listed {
            if let SurfaceEffect::Shading(of) = &listed.effect {
                usage[listed.kind].cut += of.cut();
            }
        }
    }

    /// What has a limit: its name, the most that there was, and the limit. `None` without effects.
    #[must_use]
    pub fn high_water(&self) -> Option<[(&'static str, (usize, usize)); 2]> {
        let faces = self.listed.iter().map(|listed| match &listed.effect {
            SurfaceEffect::Shading(of) => of.high_water(),
            _ => 0,
        });
        let faces = faces.max()?;
        Some([
            (
                "contacts with effects",
                (self.contacts.high_water(), MAX_CONTACTS),
            ),
            ("faces under shading", (faces, MAX_SHADING_FACES)),
        ])
    }
}

#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
enum SceneEffect {
    Vibration(vibration::Vibration),
    Viscosity(viscosity::Viscosity),
    Spring(spring::Spring),
    Gravity(gravity::Gravity),
    Inertia(inertia::Inertia),
    Boundary(boundary::Boundary),
}

/// Effects of a scene on one probe.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct SceneEffects(Vec<Listed<SceneEffect>>);

impl SceneEffects {
    /// The scene effects among the plans, in their order.
    #[must_use]
    pub fn new(plans: &[EffectPlan]) -> Self {
        let effects = plans.iter().filter_map(|plan| {
            let effect = match &plan.effect {
                Effect::Vibration(of) => SceneEffect::Vibration(vibration::Vibration::new(*of)),
                Effect::Viscosity { damping_ns_per_m } => {
                    SceneEffect::Viscosity(viscosity::Viscosity::new(*damping_ns_per_m))
                }
                Effect::Spring(of) => SceneEffect::Spring(spring::Spring::new(of.clone())),
                Effect::Gravity(of) => SceneEffect::Gravity(gravity::Gravity::new(*of)),
                Effect::Inertia(of) => SceneEffect::Inertia(inertia::Inertia::new(*of)),
                Effect::Boundary(of) => SceneEffect::Boundary(boundary::Boundary::new(*of)),
                _ => return None,
            };
            Some(Listed::new(plan, effect))
        });
        Self(effects.collect())
    }

    /// Whether there is no effect.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The next pose of the device is no motion: the mass of inertia is at rest there, and a spring
    /// is at the nearest point of its path.
    pub fn go_to_new_place(&mut self) {
        for listed in &mut self.0 {
            match &mut listed.effect {
                SceneEffect::Inertia(of) => of.go_to_new_place(),
                SceneEffect::Spring(of) => of.go_to_new_place(),
                _ => {}
            }
        }
    }

    /// Adds the effects on a probe.
    pub fn render(&mut self, clock: Clock, device: &DeviceSample<'_>, out: &mut Rendered) {
        let DeviceSample {
            pose,
            velocity,
            elapsed,
            ..
        } = *device;
        for listed in &mut self.0 {
            let Some((effect, amount)) = listed.called(clock) else {
                continue;
            };
            let position = pose.position;
            match effect {
                SceneEffect::Vibration(of) => out.active.force += of.force(clock) * amount,
                SceneEffect::Viscosity(of) => out.active.force += of.force(velocity) * amount,
                SceneEffect::Spring(of) => {
                    out.active.force += of.force(position, velocity) * amount
                }
                SceneEffect::Gravity(of) => {
                    let weight = of.wrench(pose.orientation);
                    out.active.force += weight.force * amount;
                    out.active.torque += weight.torque * amount;
                }
                SceneEffect::Inertia(of) => {
                    let periods = (elapsed, clock.period_s);
                    out.active.force += of.force(position, velocity, periods) * amount;
                }
                SceneEffect::Boundary(of) => {
                    let (wrench, spring) = of.render(device, amount, clock.period_s);
                    out.passive = out.passive + wrench;
                    out.spring = out.spring + spring;
                }
            }
        }
    }

    /// Adds the calls and bytes of each kind to `usage`.
    pub fn add_usage(&self, usage: &mut UsageByKind) {
        add_usage(&self.0, usage);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tool on a surface that is not looked at.
    pub struct Bench {
        mesh: spm::ActiveMesh,
        tree: ab_tree::AbTree,
        gyration_m: f64,
        tick: u64,
        pub pose: Pose,
    }

    impl Bench {
        pub fn new(gyration_m: f64) -> Self {
            Self {
                mesh: spm::ActiveMesh::new(0, 0, 0),
                tree: ab_tree::AbTree::new(1),
                gyration_m,
                tick: 0,
                pose: Pose::IDENTITY,
            }
        }

        /// The next tick.
        pub fn step(&mut self) {
            self.tick += 1;
        }

        pub fn sample<'a>(&'a self, pushes: &'a [Push]) -> ContactSample<'a> {
            ContactSample {
                max_work: u32::MAX,
                clock: Clock {
                    tick: self.tick,
                    period_s: 1e-3,
                },
                periods: [1; 2],
                goes_on: false,
                is_interrupted: false,
                surface: Surface {
                    mesh: &self.mesh,
                    tree: &self.tree,
                },
                metres_per_unit: 1.0,
                origin: DVec3::ZERO,
                to_world: DQuat::IDENTITY,
                point: DVec3::ZERO,
                middle: None,
                pushes,
                gyration_m: self.gyration_m,
                device: self.pose,
                proxy: self.pose,
                velocity: DVec3::ZERO,
                angular: DVec3::ZERO,
                moved: Twist::default(),
                stiffness_n_per_m: 800.0,
                paid_n_per_m: 800.0,
                undamped: 1.0,
            }
        }
    }

    #[test]
    fn an_effect_fades_in_and_out_and_is_not_called_outside() {
        let switch = Switch {
            from: 1.0,
            until: 2.0,
            fade: 0.1,
        };
        let amount = |tick| {
            switch.amount(Clock {
                tick,
                period_s: 1e-3,
            })
        };
        assert_eq!(amount(1000), 0.0);
        assert!((amount(1050) - 0.5).abs() < 1e-9);
        assert_eq!(amount(1500), 1.0);
        assert!((amount(2050) - 0.5).abs() < 1e-9);
        assert_eq!(amount(2100), 0.0);
        let always = Switch {
            from: 0.0,
            until: f64::INFINITY,
            ..switch
        };
        let first = always.amount(Clock {
            tick: 0,
            period_s: 1e-3,
        });
        assert_eq!(first, 1.0);
    }
}
