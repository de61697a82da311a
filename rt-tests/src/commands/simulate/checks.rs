//! What holds after every tick of a controller, whatever happened.

use super::trace::{Checked, ensure};
use geometry::Wrench;
use glam::DVec3;
use hrtc_core::record::CoreRecord;
use scene::{ProbePlan, SafetyPlan, ScenePlan};
use simulator::{Client, INBOX_CHUNKS};

/// Cache for each active object of which a tenth holds every base mesh and what a contact needs.
const AMPLE_BYTES: usize = 8 << 20;
/// Ticks within which a lowered limit of the cache holds: in them every ring is given up.
const OBEYS_TICKS: u64 = 1_000;
/// Relative rounding error of a limited change of the force.
const ROUNDING: f64 = 1e-12;

/// Limits of a controller and what it did last.
#[derive(Debug)]
pub struct Watch {
    safety: SafetyPlan,
    device_max_n: f64,
    period_s: f64,
    cache_bytes: usize,
    /// The limit of the cache, and ticks since it was changed.
    limit: (u64, u64),
    /// Whether a share of its cache is enough for a controller.
    may_be_limited: bool,
    operations: u32,
    last: Vec<Wrench>,
    accounts: Option<Vec<Account>>,
    allocations: u64,
    /// Ticks since the controller has a fault, which must end its forces.
    faulty_ticks: u64,
    /// Largest work of the queries of a tick.
    pub query_work_max: u32,
}

impl Watch {
    /// Of a controller before its first tick. `has_accounts`: whether the energy is checked.
    #[must_use]
    pub fn new(plan: &ScenePlan, device_max_n: f64, noise_m: f64, has_accounts: bool) -> Self {
        let account = |probe: &ProbePlan| Account::new(plan, probe.device.encoder_m + noise_m);
        Self {
            safety: plan.safety,
            device_max_n,
            period_s: 1.0 / plan.loop_.rate_hz,
            cache_bytes: plan.cache_bytes,
            limit: (plan.cache_bytes as u64, 0),
            may_be_limited: plan.cache_bytes >= AMPLE_BYTES * plan.active_objects(),
            operations: plan.loop_.operations as u32,
            last: vec![Wrench::ZERO; plan.probes.len()],
            accounts: has_accounts.then(|| plan.probes.iter().map(account).collect()),
            allocations: 0,
            faulty_ticks: 0,
            query_work_max: 0,
        }
    }

    /// The controller was started again: its forces begin from zero, on the same device.
    pub fn restart(&mut self) {
        self.last.fill(Wrench::ZERO);
        self.faulty_ticks = 0;
        self.allocations = 0;
        for account in self.accounts.iter_mut().flatten() {
            account.restart();
        }
    }

    /// Before a tick: the devices have moved under the forces so far. `places`: where they are,
    /// exactly, metres.
    ///
    /// # Errors
    /// When more energy came out than may.
    pub fn moved(&mut self, places: &[DVec3], periods: u64) -> Checked {
        for (account, &place) in self.accounts.iter_mut().flatten().zip(places) {
            account.moved_to(place, periods)?;
        }
        Ok(())
    }

    /// After a tick.
    ///
    /// # Errors
    /// The first check that does not hold.
    pub fn check(&mut self, client: &Client) -> Checked {
        let outputs = client.outputs();
        self.check_wrenches(client)?;
        Self::check_record(&outputs.record)?;
        let controller = client.controller();
        let record = &outputs.record;
        self.query_work_max = self.query_work_max.max(record.query_work);
        let budget = controller.work_budget();
        ensure(record.work_units <= budget, "work budget", || {
            format!("{} work units of {budget}", record.work_units)
        })?;
        let done = record.vsplits + record.ecols;
        ensure(done <= self.operations, "operations of a tick", || {
            format!("{done} splits and collapses of {}", self.operations)
        })?;
        let bytes = record.cache_bytes.max(controller.bytes_high_water() as u64);
        ensure(bytes <= self.cache_bytes as u64, "memory", || {
            format!("{bytes} bytes of {}", self.cache_bytes)
        })?;
        self.check_limit(record)?;
        ensure(client.inbox_len() <= INBOX_CHUNKS, "inbox", || {
            format!("{} chunks wait", client.inbox_len())
        })?;
        let allocated = client.allocations() - self.allocations;
        self.allocations = client.allocations();
        ensure(allocated == 0, "no allocation in a tick", || {
            format!("{allocated} in the tick")
        })?;
        self.check_fault(client)
    }

    /// What is in use beyond a lowered limit has gone after a while.
    fn check_limit(&mut self, record: &CoreRecord) -> Checked {
        let (limit, since) = self.limit;
        self.limit = if record.cache_limit_bytes == limit {
            (limit, since + 1)
        } else {
            (record.cache_limit_bytes, 0)
        };
        let obeys = record.cache_bytes <= record.cache_limit_bytes;
        let may_be_over = self.limit.1 < OBEYS_TICKS || !self.may_be_limited;
        ensure(obeys || may_be_over, "limit of the cache", || {
            format!(
                "{} bytes of {}",
                record.cache_bytes, record.cache_limit_bytes
            )
        })
    }

    fn check_wrenches(&mut self, client: &Client) -> Checked {
        let wrenches = &client.outputs().wrenches;
        let records = &client.outputs().record.probes;
        let samples = client.samples().iter().zip(records);
        let believed: Vec<Option<DVec3>> = samples
            .map(|(sample, of)| {
                let sample = sample.filter(|_| !of.rejected_sample)?;
                Some(sample.pose.position)
            })
            .collect();
        let force_max = self.safety.force_max_n.min(self.device_max_n);
        let slew = self.safety.slew_n_per_s * self.period_s;
        let torque_slew = slew * self.safety.torque_max_nm / self.safety.force_max_n;
        for (k, (now, last)) in wrenches.iter().zip(&mut self.last).enumerate() {
            let (force, torque) = (now.force.length(), now.torque.length());
            ensure(now.is_finite(), "force finite", || {
                format!("probe {k}: {now:?}")
            })?;
            ensure(
                force <= force_max && torque <= self.safety.torque_max_nm,
                "force limit",
                || format!("probe {k}: {force} N of {force_max} N, {torque} N m"),
            )?;
            let steps = [
                now.force.distance(last.force),
                now.torque.distance(last.torque),
            ];
            ensure(
                steps[0] <= slew * (1.0 + ROUNDING) && steps[1] <= torque_slew * (1.0 + ROUNDING),
                "slew limit",
                || format!("probe {k}: steps of {} N and {} N m", steps[0], steps[1]),
            )?;
            *last = *now;
            if let Some(accounts) = &mut self.accounts {
                let given_j = records[k].given_j;
                accounts[k].output(now.force, believed[k], given_j);
            }
        }
        Ok(())
    }

    fn check_record(record: &CoreRecord) -> Checked {
        for (k, probe) in record.probes.iter().enumerate() {
            let certified_m = probe.certified_error_m;
            let is_bounded = !probe.contact || probe.contact_bounded;
            ensure(
                is_bounded && certified_m.is_finite(),
                "bound of a contact",
                || format!("probe {k}: {certified_m} m certified, bounded {is_bounded}"),
            )?;
        }
        let lengths = [
            record.certified_error_m,
            record.depth_m,
            record.finest_tolerance_m,
        ];
        let numbers = [
            record.energy_j,
            record.contact_tolerance_m,
            record.measured_error_m,
        ];
        let are_good = lengths.iter().all(|&x| x.is_finite() && x >= 0.0)
            && numbers.iter().all(|x| x.is_finite());
        ensure(are_good, "numbers of the record", || {
            format!("{lengths:?} {numbers:?}")
        })
    }

    /// A controller with a fault lets its forces ramp down.
    fn check_fault(&mut self, client: &Client) -> Checked {
        let Some(fault) = client.controller().fault() else {
            self.faulty_ticks = 0;
            return Ok(());
        };
        self.faulty_ticks += 1;
        let ramp = self.safety.ramp_s + self.safety.force_max_n / self.safety.slew_n_per_s;
        let limit = (ramp / self.period_s) as u64 + 2;
        let is_gone = self.last.iter().all(|wrench| *wrench == Wrench::ZERO);
        ensure(
            self.faulty_ticks <= limit || is_gone,
            "no force after a fault",
            || format!("{} ticks after: {fault}", self.faulty_ticks),
        )
    }
}

/// The energy that a probe's forces put out in a contact, over the device's exact motion.
///
/// A contact may put out no more than it took in, beside what surfaces gave that were refined under
/// the probe, up to what no sampled controller knows in time.
/// With the largest force F and speed v of the contact, the largest error h of a position that was
/// believed (the step of the encoder with the noise, or a spike that a hand could have made), n
/// periods for which the motion was not known at the longest (a sample that did not come or was
/// rejected, a stall), and the slew limit s:
/// - two errors of a position in the balance, `2 F h` (of the encoder, the account tolerates it);
/// - the motion of the periods under way, `F v (n + 1) T`, which is known only afterwards;
/// - the force falls from F to 0 in `F / s` at best, on average with half of it: `F² v / (2 s)`.
#[derive(Debug)]
struct Account {
    slew_n_per_s: f64,
    period_s: f64,
    step_m: f64,
    /// Force in the period under way.
    force: DVec3,
    last: Option<DVec3>,
    /// Put out in this contact, joules, beside what surfaces gave.
    joules: f64,
    /// What was put out so far that they gave, joules.
    given_j: f64,
    force_max: f64,
    speed_max: f64,
    held_max: u64,
    /// Periods since the last sample that was believed.
    blind: u64,
    /// Its error, metres; and the largest error in this contact.
    error_m: f64,
    error_max_m: f64,
}

impl Account {
    fn new(plan: &ScenePlan, step_m: f64) -> Self {
        Self {
            slew_n_per_s: plan.safety.slew_n_per_s,
            period_s: 1.0 / plan.loop_.rate_hz,
            step_m,
            force: DVec3::ZERO,
            last: None,
            joules: 0.0,
            given_j: 0.0,
            force_max: 0.0,
            speed_max: 0.0,
            held_max: 1,
            blind: 0,
            error_m: 0.0,
            error_max_m: 0.0,
        }
    }

    /// The force of the coming period, and where the device was believed to be, if it was seen.
    fn output(&mut self, force: DVec3, believed: Option<DVec3>, given_j: f64) {
        self.force = force;
        self.joules -= given_j - self.given_j;
        self.given_j = given_j;
        self.blind = if believed.is_some() {
            0
        } else {
            self.blind + 1
        };
        if let (Some(believed), Some(place)) = (believed, self.last) {
            self.error_m = believed.distance(place);
        }
    }

    fn restart(&mut self) {
        self.force = DVec3::ZERO;
        self.last = None;
        self.given_j = 0.0;
        self.end();
    }

    fn end(&mut self) {
        self.joules = 0.0;
        self.force_max = 0.0;
        self.speed_max = 0.0;
        self.held_max = 1;
        self.error_max_m = 0.0;
    }

    fn moved_to(&mut self, place: DVec3, periods: u64) -> Checked {
        let Some(last) = self.last.replace(place) else {
            return Ok(());
        };
        let size = self.force.length();
        if size == 0.0 {
            self.end();
            return Ok(());
        }
        let motion = place - last;
        self.joules += self.force.dot(motion);
        self.force_max = self.force_max.max(size);
        self.held_max = self.held_max.max(self.blind + periods);
        self.error_max_m = self.error_max_m.max(self.error_m);
        let speed = motion.length() / (periods as f64 * self.period_s);
        self.speed_max = self.speed_max.max(speed);
        let (force, speed) = (self.force_max, self.speed_max);
        let error_m = self.step_m.max(self.error_max_m);
        let under_way = speed * (self.held_max + 1) as f64 * self.period_s;
        let tolerance =
            force * (2.0 * error_m + under_way + speed * force / (2.0 * self.slew_n_per_s));
        ensure(self.joules <= tolerance, "energy of a contact", || {
            let mj = 1e3;
            format!(
                "{:.4} mJ put out, {:.4} mJ tolerated (force to {force:.2} N, speed to {speed:.3} m/s)",
                self.joules * mj,
                tolerance * mj
            )
        })
    }
}
