//! What holds after every tick of a controller, whatever happened.

mod energy;

use super::trace::{Checked, ensure};
use energy::Account;
use geometry::Wrench;
use glam::DVec3;
use haptic_device::COMMAND_VALIDITY_S;
use hrtc_core::record::CoreRecord;
use scene::{ProbePlan, SafetyPlan, ScenePlan};
use simulated_device::DeviceState;
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
    /// Periods for which a wrench is valid.
    validity: u64,
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
        let period_s = 1.0 / plan.loop_.rate_hz;
        let validity = (COMMAND_VALIDITY_S / period_s).round() as u64;
        let account = |probe: &ProbePlan| {
            let step_m = probe.device.encoder_m + noise_m;
            Account::new(plan, step_m, validity)
        };
        Self {
            safety: plan.safety,
            device_max_n,
            period_s,
            validity,
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

    /// Before a tick is checked: the devices have moved under the forces so far, to their true
    /// states. Where these are no longer valid, they have gone to zero by themselves.
    ///
    /// # Errors
    /// When more energy came out than may.
    pub fn moved(&mut self, devices: &[DeviceState], periods: u64) -> Checked {
        if periods >= self.validity {
            self.last.fill(Wrench::ZERO);
        }
        for (account, device) in self.accounts.iter_mut().flatten().zip(devices) {
            account.moved_to(device, periods)?;
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
        check_work(
            record,
            [controller.work_budget(), controller.query_budget()],
        )?;
        let done = record.vsplits + record.ecols;
        ensure(done <= self.operations, "operations of a tick", || {
            format!("{done} splits and collapses of {}", self.operations)
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
        let torque_slew = slew * self.safety.torque_max_nm / force_max;
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
                accounts[k].output(now.force, believed[k], &records[k]);
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

/// Neither the work of a tick nor that of its queries is beyond its budget.
fn check_work(record: &CoreRecord, [work, queries]: [u32; 2]) -> Checked {
    ensure(record.work_units <= work, "work budget", || {
        format!("{} work units of {work}", record.work_units)
    })?;
    ensure(record.query_work <= queries, "query budget", || {
        format!("{} units of queries of {queries}", record.query_work)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_beyond_either_budget_fails() {
        let of = |work_units, query_work| {
            let record = CoreRecord {
                work_units,
                query_work,
                ..CoreRecord::default()
            };
            check_work(&record, [20, 10]).err().map(|(check, _)| check)
        };
        assert_eq!(of(20, 10), None);
        assert_eq!(of(21, 10), Some("work budget"));
        assert_eq!(of(20, 11), Some("query budget"));
    }
}
