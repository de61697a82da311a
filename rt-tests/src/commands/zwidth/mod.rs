//! `rt-tests zwidth`: the stiffest walls, against moving and against turning, that a loop with the
//! period and the delay of this machine can render without putting energy into the hand.
//!
//! Measured: period and delay, in a run of both processes on this machine, by the stamps of the
//! device that the tick reads and writes. Simulated: the walls, in virtual time, by the product's
//! controller and the scene's own device at that period and with that delay. Each stiffness is
//! touched for seconds without a break by a hand that takes no energy; the stiffest wall that then
//! has put out no more than the device damps is the limit. In theory that is `b / (T/2 + n T)`, for
//! damping b, period T and n ticks of delay (Colgate 1994, Gil 2009); a limit of the device that
//! lies further above or below than it may is a failure, and so is one of 0 where the device has
//! damping: then every wall that was tried put energy out. The energy account is off for that; how
//! far it reaches beyond is simulated too.

mod long_run;
mod stamps;
mod words;

use crate::failure::{Chosen, Failure};
use crate::processes::pair::{PairArgs, Shown, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stamped_device::{NAME, read_stamps};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{make_folder, print_either, write_whole};
use crate::scenes::{SceneFile, check_seconds, path_in_toml, prepare_models};
use clap::Args;
use hrtc::result::Finished;
use long_run::{Loaded, Wall, holds, torsion_per_stiffness};
use scene::{DeviceRotationPlan, ScenePlan, SimulatedDevicePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
pub use stamps::RealLoop;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// Dampings that the curve is drawn over, N s/m.
const DAMPINGS: [f64; 5] = [0.2, 0.5, 1.0, 2.0, 5.0];
/// The limit is looked for between theory over this and theory times this, at first.
const AROUND: f64 = 2.0;
/// Steps by which that interval is moved at the most.
const MAX_DOUBLINGS: u32 = 8;
/// Halvings of the logarithm of that interval, and what is left of it, relative.
const HALVINGS: i32 = 9;
/// Share of theory's limit by which the simulated one may lie below it, beside the uncertainty.
const BELOW_SHARE: f64 = 0.01;
/// The stiffest wall that is tried with the energy account, in units of theory's limit without.
const MAX_WITH_ACCOUNT: f64 = 32.0;

/// Arguments of `rt-tests zwidth`.
#[derive(Debug, Args)]
pub struct ZwidthArgs {
    /// Scene whose loop and first device are measured [default: the bundled first-touch scene]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Length of the run that measures period and delay
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Folder of the picture
    #[arg(long, value_name = "DIR", default_value = "reports/zwidth")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON. What is under `simulated` was simulated, and so were the fields that
/// begin with `k_max` and do not name theory.
#[derive(Debug, Serialize)]
pub struct Zwidth {
    /// The stiffest wall that put no more energy out than the device damps, N/m. Simulated.
    pub k_max_measured: f64,
    /// ... and in theory.
    pub k_max_theory: f64,
    /// By how much the former may exceed the latter, N/m: what theory leaves out of the motion (its
    /// formula is in the module of the long runs), and the width of the last interval.
    pub k_max_uncertainty: f64,
    /// Median of the loop's period, seconds. Measured.
    pub period_s: f64,
    /// Delay of the force beyond the hold of a period, ticks. Measured.
    pub delay_ticks: f64,
    /// Damping of the device, N s/m.
    pub damping: f64,
    /// The same against turning, N m/rad.
    pub k_max_torsion_measured: f64,
    /// ...
    pub k_max_torsion_theory: f64,
    /// ...
    pub k_max_torsion_uncertainty: f64,
    /// Damping of the device's rotation, N m s/rad.
    pub damping_torsion: f64,
    /// Mass of the device, kg.
    pub mass_kg: f64,
    /// Its moment of inertia, kg m².
    pub inertia_kgm2: f64,
    /// What theory allows at the longest period, N/m.
    pub k_max_longest_period_theory: f64,
    /// The stiffest wall that put no energy out with the energy account, N/m, of those up to
    /// `MAX_WITH_ACCOUNT` times theory; 0 where half of theory's limit put some out. Simulated.
    pub k_max_with_account: f64,
    /// The same against turning, N m/rad. Simulated.
    pub k_max_torsion_with_account: f64,
    /// What was measured of the loop of this machine.
    pub measured: RealLoop,
    /// Names of what was not measured but simulated.
    pub simulated: [&'static str; 5],
    /// The limit over the damping of a device; simulated, beside theory.
    pub curve: Vec<Limit>,
}

/// The limit of a device.
#[derive(Debug, Serialize)]
pub struct Limit {
    /// N s/m.
    pub damping: f64,
    /// N/m.
    pub k_max_measured: f64,
    /// N/m.
    pub k_max_theory: f64,
    /// N/m.
    pub k_max_uncertainty: f64,
}

impl Zwidth {
    /// The device's limits by name: simulated, in theory, and the uncertainty of theory.
    fn limits(&self) -> [(&'static str, [f64; 3]); 2] {
        [
            (
                "k_max_measured",
                [
                    self.k_max_measured,
                    self.k_max_theory,
                    self.k_max_uncertainty,
                ],
            ),
            (
                "k_max_torsion_measured",
                [
                    self.k_max_torsion_measured,
                    self.k_max_torsion_theory,
                    self.k_max_torsion_uncertainty,
                ],
            ),
        ]
    }

    /// Names of the limits of which this holds.
    fn named(&self, of: fn([f64; 3]) -> bool) -> Vec<&'static str> {
        let limits = self.limits().into_iter().filter(|(_, limit)| of(*limit));
        limits.map(|(name, _)| name).collect()
    }

    /// Names of the device's limits that lie further above theory than they may.
    fn beyond(&self) -> Vec<&'static str> {
        self.named(is_beyond)
    }

    /// Whether there is a limit where theory has one, and none lies further above or below theory
    /// than it may.
    fn judge(&self) -> Result<(), Failure> {
        let mut wrong = Vec::new();
        for (names, what) in [
            (self.beyond(), "further above theory than its uncertainty"),
            (
                self.named(is_missing),
                "no wall that was tried kept its energy, and theory has one",
            ),
            (
                self.named(is_below),
                "further below theory than its uncertainty",
            ),
        ] {
            if !names.is_empty() {
                wrong.push(format!("{what}: {}", names.join(", ")));
            }
        }
        if wrong.is_empty() {
            return Ok(());
        }
        Err(Failure::Run(wrong.join("; ")))
    }
}

/// Whether no wall was found where theory has one: the device has damping. What is no number is
/// said to be beyond.
fn is_missing([simulated, theory, _]: [f64; 3]) -> bool {
    theory > 0.0 && simulated <= 0.0
}

/// Whether a simulated limit that there is lies below theory by more than its uncertainty and a
/// hundredth. A wall within theory's limit puts no energy out, whatever the hand does; so what is
/// below is the interval of the search, which the uncertainty has, and the device that the
/// controller sees through its encoder.
fn is_below([simulated, theory, uncertainty]: [f64; 3]) -> bool {
    simulated > 0.0 && simulated < (1.0 - BELOW_SHARE) * theory - uncertainty
}

/// Whether a simulated limit lies above theory by more than its uncertainty. What is no number
/// does.
fn is_beyond([simulated, theory, uncertainty]: [f64; 3]) -> bool {
    let is_within = simulated <= theory + uncertainty;
    !is_within
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 when a limit lies further above or below theory than it
/// may, or there is none.
pub fn zwidth(args: &ZwidthArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let plan = load(scene.path(), &args.overrides.overrides(), &DiskFiles)?;
    make_folder(&args.out)?;
    prepare_models(&plan)?;
    check_stop(&stop)?;
    eprintln!("period and delay are measured for {} s", args.seconds);
    let mut show = |shown: Shown| {
        if let Shown::Said(who, line) = shown {
            eprintln!("{who}: {line}");
        }
    };
    let (scene, seconds) = (scene.path(), args.seconds);
    let (measured, _) = measure_until(scene, &plan, &args.overrides, seconds, &mut show, &stop)?;
    eprintln!("the walls are simulated");
    let device = &plan.probes[0].device;
    let found = Zwidth {
        curve: curve(&measured, device, &stop)?,
        ..simulate(measured, device, &stop)?
    };
    let picture = args.out.join("zwidth.svg");
    write_whole(&picture, words::draw(&found).as_bytes())?;
    let words = format!("{}picture: {}\n", words::words(&found), picture.display());
    print_either(args.json, &words, &found)?;
    found.judge()
}

/// # Errors
/// When the command is to end: what was cut short is no measure.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

/// Runs the scene with stamps, until its time is over or `stop` is set.
///
/// # Errors
/// When a process fails or starts again, the device touches too little, or the run is ended on
/// request.
pub(super) fn measure_until(
    scene: &Path,
    plan: &ScenePlan,
    overrides: &OverrideArgs,
    seconds: f64,
    show: &mut dyn FnMut(Shown),
    stop: &AtomicBool,
) -> Result<(RealLoop, Finished), Failure> {
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let [device, stamps] = ["device.toml", "stamps"].map(|name| folder.path().join(name));
    let whole = std::path::absolute(scene)
        .map_err(|error| Failure::Input(format!("{}: {error}", scene.display())))?;
    let wrong = |error: std::io::Error| Failure::write_at(Chosen::Temporary, &device, &error);
    std::fs::write(&device, stamped_device(&whole, &stamps)?).map_err(wrong)?;
    let pair = PairArgs {
        scene,
        plan,
        seconds,
        overrides,
        loop_: LoopArgs::default(),
        record: None,
        device: Some(&device),
    };
    let outcome = run_pair(&pair, stop, show);
    check_stop(stop)?;
    let outcome = outcome?;
    outcome.check_finite()?;
    let finished = outcome.undisturbed()?;
    let stamps = read_stamps(&stamps)
        .map_err(|error| Failure::Run(format!("the stamps of the device: {error}")))?;
    Ok((RealLoop::of(&stamps)?, finished))
}

/// The file of the device with stamps, for a scene.
///
/// # Errors
/// When a path is not UTF-8.
fn stamped_device(scene: &Path, stamps: &Path) -> Result<String, Failure> {
    Ok(format!(
        "[device.custom]\nname = {NAME:?}\nscene = {}\nstamps = {}\n",
        path_in_toml(scene)?,
        path_in_toml(stamps)?
    ))
}

/// Finds the limits of a loop and a device.
///
/// # Errors
/// When a wall cannot be served, or the command is to end.
fn simulate(
    measured: RealLoop,
    device: &SimulatedDevicePlan,
    stop: &AtomicBool,
) -> Result<Zwidth, Failure> {
    let rotation = device
        .rotation
        .unwrap_or_else(|| DeviceRotationPlan::of_handle(device));
    let default = SimulatedDevicePlan::default();
    let own = plate(&measured, device, device.damping_ns_per_m);
    let slot = Loaded {
        wall: Wall::Slot,
        inertia: rotation.inertia_kgm2,
        damping: rotation.damping_nms_per_rad,
        hand: some_hand(
            rotation.hand_stiffness_nm_per_rad,
            DeviceRotationPlan::of_handle(&default).hand_stiffness_nm_per_rad,
        ),
        ..own
    };
    let torsion = torsion_per_stiffness(&slot)?;
    let longest = Loaded {
        period_s: measured.longest_period_s,
        ..own
    };
    Ok(Zwidth {
        k_max_measured: stiffest(&own, 1.0, stop)?,
        k_max_theory: own.theory(),
        k_max_uncertainty: uncertainty(&own),
        period_s: measured.period_s,
        delay_ticks: measured.delay_ticks(),
        damping: own.damping,
        k_max_torsion_measured: stiffest(&slot, torsion, stop)?,
        k_max_torsion_theory: slot.theory(),
        k_max_torsion_uncertainty: uncertainty(&slot),
        damping_torsion: slot.damping,
        mass_kg: own.inertia,
        inertia_kgm2: slot.inertia,
        k_max_longest_period_theory: longest.theory(),
        k_max_with_account: stiffest_with_account(&own, 1.0, stop)?,
        k_max_torsion_with_account: stiffest_with_account(&slot, torsion, stop)?,
        measured,
        simulated: [
            "k_max_measured",
            "k_max_torsion_measured",
            "k_max_with_account",
            "k_max_torsion_with_account",
            "curve.k_max_measured",
        ],
        curve: Vec::new(),
    })
}

/// The limits of plates over the damping of a device.
///
/// # Errors
/// When a wall cannot be served, or the command is to end.
fn curve(
    measured: &RealLoop,
    device: &SimulatedDevicePlan,
    stop: &AtomicBool,
) -> Result<Vec<Limit>, Failure> {
    let limit = |damping: f64| {
        let loaded = plate(measured, device, damping);
        Ok(Limit {
            damping,
            k_max_measured: stiffest(&loaded, 1.0, stop)?,
            k_max_theory: loaded.theory(),
            k_max_uncertainty: uncertainty(&loaded),
        })
    };
    DAMPINGS.into_iter().map(limit).collect()
}

/// A plate under a device with another damping, N s/m.
pub(super) fn plate(measured: &RealLoop, device: &SimulatedDevicePlan, damping: f64) -> Loaded {
    Loaded {
        wall: Wall::Plate,
        period_s: measured.period_s,
        delay_ticks: measured.delay_ticks(),
        inertia: device.mass_kg,
        damping,
        hand: some_hand(
            device.hand.stiffness_n_per_m,
            SimulatedDevicePlan::default().hand.stiffness_n_per_m,
        ),
    }
}

/// The spring of a hand, or the default where it has none: it could not press.
fn some_hand(own: f64, default: f64) -> f64 {
    if own > 0.0 { own } else { default }
}

fn uncertainty(loaded: &Loaded) -> f64 {
    let width = 2.0 * AROUND.ln() * 0.5f64.powi(HALVINGS);
    loaded.theory() * (loaded.uncertainty() + width)
}

/// The stiffest wall that puts no energy out without the account; a surface of 1 N/m is a wall of
/// `a_unit`. 0 where even theory's limit over 2 to the ninth puts energy out, and for a device
/// without damping, which has none.
fn stiffest(loaded: &Loaded, a_unit: f64, stop: &AtomicBool) -> Result<f64, Failure> {
    let theory = loaded.theory();
    if theory <= 0.0 {
        return Ok(0.0);
    }
    let is_passive = |stiffness: f64| {
        check_stop(stop)?;
        holds(loaded, [stiffness / a_unit, stiffness], false)
    };
    let (mut low, mut high) = (theory / AROUND, theory * AROUND);
    let mut found = is_passive(low)?;
    for _ in 0..MAX_DOUBLINGS {
        if found {
            break;
        }
        (low, high) = (low / AROUND, low);
        found = is_passive(low)?;
    }
    if !found {
        return Ok(0.0);
    }
    for _ in 0..MAX_DOUBLINGS {
        if !is_passive(high)? {
            break;
        }
        (low, high) = (high, high * AROUND);
    }
    for _ in 0..HALVINGS {
        let middle = (low * high).sqrt();
        if is_passive(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(low)
}

/// The same with the account, by doubling.
fn stiffest_with_account(loaded: &Loaded, a_unit: f64, stop: &AtomicBool) -> Result<f64, Failure> {
    let is_passive = |stiffness: f64| {
        check_stop(stop)?;
        holds(loaded, [stiffness / a_unit, stiffness], true)
    };
    stiffest_by_doubling(loaded.theory(), is_passive)
}

/// The stiffest passive wall of half of theory's limit and its doubles; 0 where not even the first
/// is passive.
fn stiffest_by_doubling(
    theory: f64,
    is_passive: impl Fn(f64) -> Result<bool, Failure>,
) -> Result<f64, Failure> {
    let mut stiffness = 0.5 * theory;
    if stiffness <= 0.0 || !is_passive(stiffness)? {
        return Ok(0.0);
    }
    let most = MAX_WITH_ACCOUNT * theory;
    while stiffness < most && is_passive(2.0 * stiffness)? {
        stiffness *= 2.0;
    }
    Ok(stiffness)
}

#[cfg(test)]
mod tests;
