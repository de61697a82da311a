//! Interrupts of devices that a core serves: the kernel charges them to the thread that runs there.

use std::fmt;
use std::fs::read_to_string;

/// Interrupts a second, on average since the machine started, from which on a device counts: one
/// that is seldom used stays below.
const NOTABLE_PER_S: u64 = 1;

/// A device that interrupts a core.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceInterrupt {
    /// Its number, as in `/proc/irq`.
    pub number: u32,
    /// What the kernel calls it.
    pub name: String,
    /// Interrupts of that core since the machine started.
    pub count: u64,
}

/// Devices that interrupt the core of a loop, and the cores that could serve them instead.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InterruptedCore {
    core: usize,
    /// At least one, the busiest first.
    devices: Vec<DeviceInterrupt>,
    /// As `smp_affinity_list` takes them.
    others: String,
}

impl InterruptedCore {
    /// Looks at what the kernel tells; `None` when nothing notable interrupts the core, or when
    /// there is no other core for it.
    #[must_use]
    pub fn look(core: usize) -> Option<Self> {
        let table = read_to_string("/proc/interrupts").unwrap_or_default();
        let uptime = read_to_string("/proc/uptime").unwrap_or_default();
        let mut devices = served(&table, core);
        devices.retain(|device| {
            device.count >= NOTABLE_PER_S * seconds(&uptime) && is_served_by(device.number, core)
        });
        devices.sort_by_key(|device| std::cmp::Reverse(device.count));
        let others = others(&columns(&table), core)?;
        (!devices.is_empty()).then_some(Self {
            core,
            devices,
            others,
        })
    }
}

impl fmt::Display for InterruptedCore {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of = |device: &DeviceInterrupt| format!("{} (IRQ {})", device.name, device.number);
        let names: Vec<String> = self.devices.iter().map(of).collect();
        let numbers = self.devices.iter().map(|of| of.number.to_string());
        write!(
            f,
            "devices interrupt core {}, and their work there counts as the tick's own: {}; have other cores serve them, as root: for i in {}; do echo {} > /proc/irq/$i/smp_affinity_list; done",
            self.core,
            names.join(", "),
            numbers.collect::<Vec<_>>().join(" "),
            self.others,
        )
    }
}

/// Cores by how often devices interrupt each, the quietest first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QuietCores(Vec<CoreLoad>);

/// How often devices interrupt a core.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CoreLoad {
    /// The core.
    pub core: usize,
    /// Interrupts a minute by the devices that it serves now, on average since the machine started.
    pub per_minute: u64,
}

impl QuietCores {
    /// Looks at what the kernel tells of these cores.
    #[must_use]
    pub fn look(cores: &[usize]) -> Self {
        let table = read_to_string("/proc/interrupts").unwrap_or_default();
        let uptime = read_to_string("/proc/uptime").unwrap_or_default();
        let minutes = (seconds(&uptime) / 60).max(1);
        let load = |&core: &usize| {
            let devices = served(&table, core).into_iter();
            let now = devices.filter(|of| is_served_by(of.number, core));
            let per_minute = now.map(|of| of.count).sum::<u64>() / minutes;
            CoreLoad { core, per_minute }
        };
        Self::of(cores.iter().map(load).collect())
    }

    /// In order. Loads of the same power of two are equal, so that two looks agree; of equal cores
    /// the last comes first, since the kernel's own work tends to the first.
    fn of(mut loads: Vec<CoreLoad>) -> Self {
        loads.sort_by_key(|of| (of.per_minute.checked_ilog2(), std::cmp::Reverse(of.core)));
        Self(loads)
    }

    /// The cores, the quietest first.
    pub fn iter(&self) -> impl Iterator<Item = CoreLoad> + '_ {
        self.0.iter().copied()
    }
}

/// The cores of the columns of `/proc/interrupts`.
fn columns(table: &str) -> Vec<usize> {
    let head = table.lines().next().unwrap_or_default();
    let core = |word: &str| word.strip_prefix("CPU")?.parse().ok();
    head.split_whitespace().filter_map(core).collect()
}

/// Devices that have interrupted a core, after `/proc/interrupts`; lines of other forms are passed
/// over.
fn served(table: &str, core: usize) -> Vec<DeviceInterrupt> {
    let columns = columns(table);
    let Some(column) = columns.iter().position(|&of| of == core) else {
        return Vec::new();
    };
    let device = |line: &str| {
        let (number, rest) = line.split_once(':')?;
        // The kernel's own have names here.
        let number = number.trim().parse().ok()?;
        let mut words = rest.split_whitespace().skip(column);
        let count = words.next()?.parse().ok()?;
        let name = words.last()?.to_owned();
        Some(DeviceInterrupt {
            number,
            name,
            count,
        })
    };
    table.lines().skip(1).filter_map(device).collect()
}

/// Whether a core serves an interrupt now: counts do not fall when it is moved. Without a word of
/// the kernel the count decides.
fn is_served_by(number: u32, core: usize) -> bool {
    let list = |file: &str| read_to_string(format!("/proc/irq/{number}/{file}"));
    let list = list("effective_affinity_list").or_else(|_| list("smp_affinity_list"));
    list.map_or(true, |list| has(&list, core))
}

/// Whether a list such as `0-3,8` has a core.
pub(crate) fn has(list: &str, core: usize) -> bool {
    list.trim().split(',').any(|part| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let of = |text: &str| text.parse::<usize>();
        matches!((of(first), of(last)), (Ok(first), Ok(last)) if (first..=last).contains(&core))
    })
}

/// All cores but one as a list such as `0,2-3`; `None` without any.
fn others(cores: &[usize], core: usize) -> Option<String> {
    let mut ranges: Vec<(usize, usize)> = Vec::new();
    for &other in cores.iter().filter(|&&of| of != core) {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == other => *last = other,
            _ => ranges.push((other, other)),
        }
    }
    let text = |&(first, last): &(usize, usize)| match first == last {
        true => first.to_string(),
        false => format!("{first}-{last}"),
    };
    let list: Vec<String> = ranges.iter().map(text).collect();
    (!list.is_empty()).then(|| list.join(","))
}

/// Whole seconds since the start of the machine, after `/proc/uptime`; 0 when it does not say.
fn seconds(uptime: &str) -> u64 {
    let whole = uptime.split('.').next().unwrap_or_default();
    whole.trim().parse().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &str = "\
           CPU0       CPU1       CPU3
  1:          0          9          2   IO-APIC    1-edge      i8042
 24:          7          0 PCI-MSIX-0000:00:01.0
 36:          0    2114340         12 PCI-MSIX-0000:00:02.0   1-edge      virtio1-req.0
NMI:          0          0          0   Non-maskable interrupts
LOC:   19338239   11888616          3   Local timer interrupts
ERR:          0
garbage
";

    #[test]
    fn the_column_of_a_core_is_read_and_other_lines_are_passed_over() {
        let names = |core| {
            let all = served(TABLE, core).into_iter();
            all.map(|of| (of.number, of.name, of.count))
                .collect::<Vec<_>>()
        };
        let keyboard = |count| (1, "i8042".to_owned(), count);
        let disk = |count| (36, "virtio1-req.0".to_owned(), count);
        assert_eq!(
            names(1)[..2],
            [keyboard(9), (24, "PCI-MSIX-0000:00:01.0".to_owned(), 0)]
        );
        assert_eq!(names(1)[2], disk(2_114_340));
        // The third column is core 3: core 2 is off. A line that ends before it has none.
        assert_eq!(names(3), [keyboard(2), disk(12)]);
        assert_eq!(names(2), []);
        assert_eq!(served("", 0), []);
    }

    #[test]
    fn the_core_that_devices_interrupt_least_comes_first() {
        let order = |loads: &[(usize, u64)]| -> Vec<usize> {
            let load = |&(core, per_minute)| CoreLoad { core, per_minute };
            let cores = QuietCores::of(loads.iter().map(load).collect());
            cores.iter().map(|of| of.core).collect()
        };
        // The disk is on core 1.
        assert_eq!(order(&[(0, 211), (1, 5500)]), [0, 1]);
        // What differs little may differ the other way a second later.
        assert_eq!(order(&[(0, 130), (1, 250), (2, 140)]), [2, 1, 0]);
        assert_eq!(order(&[(0, 0), (1, 1), (3, 0)]), [3, 0, 1]);
        assert_eq!(order(&[]), [0usize; 0]);
    }

    #[test]
    fn the_cores_of_this_machine_are_ordered() {
        let cores = crate::rights::usable_cores();
        assert!(!cores.is_empty());
        let mut ordered: Vec<usize> = QuietCores::look(&cores).iter().map(|of| of.core).collect();
        ordered.sort_unstable();
        assert_eq!(ordered, cores);
    }

    #[test]
    fn lists_of_cores_are_read_and_written() {
        for (list, core, expected) in [
            ("1\n", 1, true),
            ("0-3,8\n", 2, true),
            ("0-3,8", 8, true),
            ("0-3,8", 4, false),
            ("10", 1, false),
            ("", 0, false),
            ("x-y,-", 0, false),
        ] {
            assert_eq!(has(list, core), expected, "{list:?} {core}");
        }
        assert_eq!(others(&[0, 1, 2, 3, 8], 1).unwrap(), "0,2-3,8");
        assert_eq!(others(&[0, 1], 1).unwrap(), "0");
        assert_eq!(others(&[0], 0), None);
        assert_eq!(seconds("24033.72 47000.01\n"), 24_033);
        assert_eq!(seconds(""), 0);
    }

    #[test]
    fn the_sentence_names_device_and_command() {
        let found = InterruptedCore {
            core: 1,
            devices: served(TABLE, 1).split_off(2),
            others: "0,3".to_owned(),
        };
        let sentence = found.to_string();
        let command = "for i in 36; do echo 0,3 > /proc/irq/$i/smp_affinity_list; done";
        assert!(sentence.contains("core 1") && sentence.ends_with(command));
        assert!(sentence.contains("virtio1-req.0 (IRQ 36)"), "{sentence}");
    }
}
