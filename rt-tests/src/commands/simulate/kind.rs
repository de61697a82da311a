//! The kinds of faults, and of hard things in a scene, that a seed may draw.

use clap::ValueEnum;
use serde::Serialize;

/// Something that a run has or has not. A seed draws which; a failing one drops them one by one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The link loses messages
    Loss,
    /// Messages arrive twice
    Duplicates,
    /// Messages overtake others
    Reordering,
    /// Bits of chunks are flipped
    Damage,
    /// Messages take long, and not equally long
    Delay,
    /// The link is narrow
    Bandwidth,
    /// Nothing crosses the link of a controller for a while
    Cut,
    /// The station is stopped for a while and goes on as it was
    StationSilent,
    /// The station is killed and started again at once
    StationRestart,
    /// The station is killed and comes back later
    StationDown,
    /// A station of another version runs for a while: its hello is refused
    OtherVersion,
    /// The station comes back with another model under the same name
    Rebuilt,
    /// A controller is killed and started again
    ControllerRestart,
    /// The device's samples are noisy
    Noise,
    /// The device's samples have spikes
    Spikes,
    /// The device's samples are no numbers
    Nonsense,
    /// The device misses samples
    Missing,
    /// Periods are skipped
    Stalls,
    /// The cache holds little more than it must
    SmallCache,
    /// Another accuracy is asked for now and then
    Tolerance,
    /// The faults begin with the run, not when it touches
    Early,
    /// Several controllers at one station
    Controllers,
    /// Several probes at a controller
    Probes,
    /// Several objects
    Objects,
    /// Objects that move
    Movables,
    /// Effects of the scene and of its surfaces
    Effects,
    /// Tools: capsules, cylinders and meshes
    Tools,
    /// A station of another scene runs for a while, and a controller is started again meanwhile
    OtherScene,
    /// Chunks travel compact, as between two machines
    Compact,
    /// The processor of a controller is up to four times slower for a while
    Processor,
    /// The cache's limit is lowered for a while
    CacheLimit,
}

impl Kind {
    /// All kinds, in the order of their numbers.
    #[must_use]
    pub fn all() -> &'static [Self] {
        Self::value_variants()
    }

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> String {
        self.to_possible_value()
            .map_or_else(String::new, |value| value.get_name().to_string())
    }

    /// Whether it is a property of the scene; else it is a fault of the link, the processes or the
    /// device, and ends with the faults.
    #[must_use]
    pub fn is_of_scene(self) -> bool {
        self >= Self::SmallCache
            && ![
                Self::Tolerance,
                Self::Early,
                Self::OtherScene,
                Self::Compact,
                Self::Processor,
                Self::CacheLimit,
            ]
            .contains(&self)
    }
}
