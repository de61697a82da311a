//! The hard cases, each with its measure, its limit and a fault under which it must fail.
//!
//! The pure cores run in virtual time, with the simulated device where the loop is closed; every
//! run repeats. A case that passes with its fault put in shows nothing (`--faults`).
//!
//! | file | cases |
//! |---|---|
//! | `walls` | energy, onset and creep of the force, the encoder |
//! | `sheets` | nothing is passed: thin, sharp, broken, or coarse |
//! | `corners` | ridges, valleys, tips and corners |
//! | `effects` | friction, texture, fields: energy, drift, switching |
//! | `fronts` | a front that moves, files in any unit |
//! | `motion` | objects that are driven onto a probe, or pushed by one |
//! | `rotation` | tools that a hand turns: energy at a device of six degrees of freedom |
//! | `refinement` | splits and collapses under the probe |
//! | `disturbances` | jumps, noise, a station that goes away, another scale |
//! | [`mod@bench`], `shapes` | a controller that touches one mesh; meshes of the cases |
//! | [`held_tool`] | a tool in a hand, the loop closed in six degrees of freedom |
//! | `found` | the size of a run of a case, and its result |

pub mod bench;
mod corners;
mod disturbances;
mod effects;
mod found;
mod fronts;
pub mod held_tool;
mod motion;
mod refinement;
mod rotation;
mod shapes;
mod sheets;
pub mod walls;

pub use bench::Fault;
pub use found::{Found, Size, Trial};

use crate::failure::Failure;

/// Runs a case.
type Run = fn(Trial<'_>) -> Result<Found, Failure>;

/// A hard case.
pub struct Case {
    /// Name.
    pub name: &'static str,
    /// Its measure, in words.
    pub measure: &'static str,
    /// The largest value that passes.
    pub limit: f64,
    /// The fault under which it must fail.
    pub fault: Fault,
    /// Runs it.
    pub run: Run,
}

/// How far the proxy's own convergence (1e-7 radii) shows in a force: ten times that, a tenth of a
/// radius deep.
const CONVERGENCE: f64 = 1e-6;

/// Energy that a balance at a device does not tell from 0, joules: of 1 N over a tenth of an
/// encoder's step.
const ENERGY_SEEN_J: f64 = 1e-6;

/// The cases, each in two lines.
#[rustfmt::skip]
pub const CASES: [Case; 47] = [
    case("head-on-wall", "energy put out over K T/2 times the integral of v²",
        1.1, Fault::LateTick, walls::head_on),
    case("net-passivity", "energy put out less what the device damps, J",
        0.0, Fault::LateTick, walls::net_passivity),
    case("passivity", "the same at 0.1 to 10 kN/m, with the energy account, J",
        0.0, Fault::NoPassivity, walls::passivity),
    case("missed-ticks", "energy put out 20 ticks after a missed period, J",
        0.0, Fault::Sign, walls::missed_ticks),
    case("thin-sheet", "passes through sheets of 0, 0.1 and 1 mm",
        0.0, Fault::LostConstraint, sheets::thin_sheet),
    case("edges-and-vertices", "passes through a body at edges and vertices",
        0.0, Fault::LostConstraint, sheets::edges_and_vertices),
    case("ridge", "change of force in a tick over 2 F sin(turn/2)",
        1.0 + CONVERGENCE, Fault::LostConstraint, corners::ridge),
    case("shaded-ridge", "change of force in a tick over the force, shaded",
        0.07, Fault::LostConstraint, corners::shaded_ridge),
    case("valley", "outside one of two planes, of the size",
        1e-9, Fault::LostConstraint, corners::valley),
    case("tip", "from the exact projection on 3 to 64 planes, of the size",
        1e-9, Fault::LostConstraint, corners::tip),
    case("corner-at-rest", "stray of the proxy in a noisy corner, radii",
        1e-5, Fault::LostConstraint, corners::rest_in_corner),
    case("scale", "difference at 1e-4 to 1e4 times the size, relative",
        1e-9, Fault::AbsoluteEpsilon, disturbances::scale),
    case("units", "difference in files of units of 1e-6 to 1e6, relative",
        1e-9, Fault::AbsoluteEpsilon, fronts::units),
    case("slow-onset", "first force over K v T",
        1.05, Fault::LateTick, walls::onset),
    case("creep", "force along a smooth plate, of K times the size",
        1e-9, Fault::Sign, walls::creep),
    case("rest", "stray of the force from K times the depth, relative",
        1e-9, Fault::Sign, disturbances::rest),
    case("damaged-mesh", "passes through a damaged mesh, or no numbers",
        0.0, Fault::LostConstraint, sheets::damaged_mesh),
    case("refit", "nearest faces that are not, after each split or collapse",
        0.0, Fault::LostConstraint, fronts::refit),
    case("prediction-miss", "true error over its bound on a coarse front",
        1.0, Fault::LostConstraint, sheets::prediction_miss),
    case("refine-under-contact", "change of force in a tick over max(0.05 N, 7 %)",
        1.0, Fault::NoGeomorph, refinement::under_contact),
    case("refine-under-tool", "the same under a tool",
        1.0, Fault::NoGeomorph, refinement::under_tool),
    case("refine-cycle-energy", "energy of coarse-fine-coarse over K p s + K s²/2",
        1e-12, Fault::NoPassivity, refinement::cycle_energy),
    case("fold-over", "change of force in a tick over it, while folds are passed",
        1.0, Fault::NoGeomorph, refinement::fold_over),
    case("silent-station", "change of the force while the station is away, N",
        0.0, Fault::LostConstraint, disturbances::silent_station),
    case("jumps", "change of force in a tick over the slew limit",
        1.0 + 1e-9, Fault::NoForceLimit, disturbances::jumps),
    case("samples-of-noise", "outputs that are no numbers, or beyond the limit",
        0.0, Fault::NoForceLimit, disturbances::noise),
    case("repeat", "ticks at which the same inputs gave other bits",
        0.0, Fault::LateTick, disturbances::repeat),
    case("encoder", "amplitude of the force over K D",
        1.0 + 1e-9, Fault::Sign, walls::encoder),
    case("friction-loop", "energy that friction puts out on a loop, of its work",
        1e-12, Fault::Sign, effects::friction_loop),
    case("friction-stick", "stray of the force after ten minutes' sticking, relative",
        1e-9, Fault::Sign, effects::friction_stick),
    case("friction-apart", "ticks at which two probes feel each other's friction",
        0.0, Fault::LateTick, effects::friction_apart),
    case("texture-loop", "energy that texture and shading put out, of their work",
        1e-12, Fault::NoPassivity, effects::texture_loop),
    case("texture-alias", "force of waves too fine for the loop, of K A",
        1e-9, Fault::Sign, effects::texture_alias),
    case("magnet-loop", "energy a magnet puts out over K T/2 times that of v²",
        1.1, Fault::LateTick, effects::magnet_loop),
    case("fields", "swing at the end over the first, springs and drags",
        0.1, Fault::LateTick, effects::fields),
    case("boundary", "energy put out less what the device damps, J",
        0.0, Fault::NoPassivity, effects::boundary),
    case("effects-toggled", "change of force in a tick over the slew limit",
        1.0 + 1e-9, Fault::NoForceLimit, effects::toggled),
    case("effects-unlisted", "ticks at which an effect that is off changes a bit",
        0.0, Fault::LateTick, effects::unlisted),
    case("moving-object", "passes or gaps of two ticks, driven at 1 m/s or 10 rad/s",
        0.0, Fault::LostConstraint, motion::moving_object),
    case("pushed-energy", "energy of device and body over that in the beginning",
        1.0 + 1e-9, Fault::NoPassivity, motion::pushed_energy),
    case("pushed-momentum", "stray of their momentum, relative",
        1e-9, Fault::LateTick, motion::pushed_momentum),
    case("pushed-reference", "from 64 times the rate, relative, over the swing in a tick",
        1.0, Fault::Sign, motion::pushed_reference),
    case("pushed-rest", "pushed bodies that do not sleep, or change in sleep",
        0.0, Fault::Restless, motion::pushed_rest),
    case("turned-in-slot", "energy put out at the device, J",
        ENERGY_SEEN_J, Fault::NoPassivity, rotation::in_slot),
    case("twisted-on-plate", "energy put out at the device, J",
        ENERGY_SEEN_J, Fault::NoPassivity, rotation::on_plate),
    case("tilted-in-hole", "energy put out at the device, J",
        ENERGY_SEEN_J, Fault::NoPassivity, rotation::in_hole),
    case("rocked-on-edge", "energy put out at the device, J",
        ENERGY_SEEN_J, Fault::NoPassivity, rotation::on_edge),
];

const fn case(
    name: &'static str,
    measure: &'static str,
    limit: f64,
    fault: Fault,
    run: Run,
) -> Case {
    Case {
        name,
        measure,
        limit,
        fault,
        run,
    }
}
