//! The scenes of the whole: what is asked of the links, and how a touch fares over distance and
//! bandwidth, for three models.

use super::HostsArgs;
use super::asked::{ASKED, TERRAIN};
use super::session::{Ask, Setting, Touch};
use crate::failure::Failure;
use crate::links::points::{Guest, curves};
use crate::scenes::SceneFile;
use scene_args::OverrideArgs;
use std::path::{Path, PathBuf};

/// The model of which everything is asked, and the one of which the curves are made too.
const BUNNY: &str = "stanford-bunny.obj";
const DRAGON: &str = "dragon.obj";
/// Their folder, beside the checkout.
const MODELS: &str = "../shared/models";
/// Cache of both, so that not everything is simply loaded.
const CACHE: &str = "4MiB";
/// Speed of the hand, m/s.
const SPEED_M_PER_S: f64 = 0.1;
/// Longest side of the terrain, metres.
const TERRAIN_M: f64 = 2.0;
/// Three controllers: a near one, one far away behind a thin line, and one that is stopped.
const CONTROLLERS: [&str; 3] = ["20:100", "100:0.25", "20:100:stopped"];

/// Scenes of the whole, with what is left out.
pub struct Plan {
    /// The scenes.
    pub settings: Vec<Setting>,
    /// What is not in them, and why.
    pub left_out: Vec<String>,
}

impl Plan {
    /// The scenes, of the models that are there.
    ///
    /// # Errors
    /// One sentence when one is refused.
    pub fn new(args: &HostsArgs) -> Result<Self, Failure> {
        let mut left_out = Vec::new();
        let bunny = named(args, BUNNY, &mut left_out);
        let dragon = named(args, DRAGON, &mut left_out);
        if bunny.is_none() {
            left_out.push("the bundled relief is touched in place of the bunny".to_string());
        }
        let overrides = |model: Option<PathBuf>| OverrideArgs {
            model,
            cache: args.overrides.cache.clone().or(Some(CACHE.to_string())),
            speed: args.overrides.speed.or(Some(SPEED_M_PER_S)),
            ..args.overrides.clone()
        };
        let bundled = || SceneFile::named_or_bundled(None);
        let mut settings = vec![Setting::new(bundled()?, &overrides(bunny), of_bunny()?)?];
        if dragon.is_some() {
            let touches = curves().map(Touch::alone).collect();
            settings.push(Setting::new(bundled()?, &overrides(dragon), touches)?);
        }
        let of_terrain = OverrideArgs {
            speed: overrides(None).speed,
            ..args.overrides.clone()
        };
        let scene = SceneFile::of_text("terrain.toml", &terrain(args.terrain_faces))?;
        let touches = curves().map(|point| {
            if point == TERRAIN.guest().point {
                Touch::asked(&TERRAIN)
            } else {
                Touch::alone(point)
            }
        });
        settings.push(Setting::new(scene, &of_terrain, touches.collect())?);
        Ok(Self { settings, left_out })
    }

    /// Touches in all, those on one machine too.
    #[must_use]
    pub fn touches(&self) -> usize {
        self.settings.iter().map(|of| 1 + of.touches.len()).sum()
    }
}

/// A model of the folder, or why it is left out.
fn named(args: &HostsArgs, name: &str, left_out: &mut Vec<String>) -> Option<PathBuf> {
    let folder = args.models.as_deref().unwrap_or(Path::new(MODELS));
    let path = folder.join(name);
    if path.is_file() {
        return Some(path);
    }
    left_out.push(format!(
        "{name} is left out: it is not in {}, name its folder with --models",
        folder.display()
    ));
    None
}

/// Everything that is asked, the links of the curves that are not among them, and several
/// controllers at once, after a touch alone over the link of each.
fn of_bunny() -> Result<Vec<Touch>, Failure> {
    let guests = CONTROLLERS.map(|typed| typed.parse());
    let guests: Result<Vec<Guest>, String> = guests.into_iter().collect();
    let guests = guests.map_err(Failure::Input)?;
    let mut touches: Vec<Touch> = ASKED.iter().map(Touch::asked).collect();
    let of_guests = guests.iter().map(|guest| guest.point);
    for alone in curves().chain(of_guests).map(Touch::alone) {
        if !touches.iter().any(|of| of.guests == alone.guests) {
            touches.push(alone);
        }
    }
    let ask = Ask::AsAlone;
    touches.push(Touch { guests, ask });
    Ok(touches)
}

/// Scene of a generated terrain.
fn terrain(faces: u32) -> String {
    format!(
        "[[object]]\ngenerate = {{ shape = \"terrain\", faces = {faces} }}\nsize_m = {TERRAIN_M}\n\n\
         [[probe]]\ntrajectory = {{ tour = {{ seed = 1 }} }}\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::{Arguments, Command};
    use clap::Parser;

    fn plan(folder: &Path) -> Plan {
        let typed = ["rt-tests", "hosts", "--terrain-faces=2000", "--models"];
        let typed = typed.map(PathBuf::from).into_iter().chain([folder.into()]);
        let Command::Hosts(args) = Arguments::parse_from(typed).command else {
            panic!("another command");
        };
        assert!(args.is_long());
        Plan::new(&args).unwrap()
    }

    #[test]
    fn the_whole_is_done_in_time_and_says_what_is_not_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let none = plan(folder.path());
        assert_eq!((none.settings.len(), none.left_out.len()), (2, 3));
        for model in [BUNNY, DRAGON] {
            std::fs::write(folder.path().join(model), "").unwrap();
        }
        let all = plan(folder.path());
        assert_eq!((all.settings.len(), all.left_out.len()), (3, 0));
        // 10 s each, and 3 s for the start of both programs; ten minutes for cuts and strangers.
        assert!(all.touches() * 13 < (45 - 10) * 60);
        // Of every model, all of both curves.
        for setting in &all.settings {
            for point in curves() {
                let touch = vec![Guest::at(point)];
                let times = setting.touches.iter().filter(|of| of.guests == touch);
                assert_eq!(times.count(), 1, "{point}");
            }
        }
        let bunny = &all.settings[0].touches;
        let (together, before) = bunny.split_last().unwrap();
        assert!(together.ask == Ask::AsAlone && together.guests.len() == 3);
        for guest in &together.guests {
            let alone = vec![Guest::at(guest.point)];
            assert!(before.iter().any(|of| of.guests == alone), "{guest:?}");
        }
        let asked = |of: &&Touch| matches!(of.ask, Ask::Link(_));
        assert_eq!(bunny.iter().filter(asked).count(), ASKED.len());
        assert_eq!(all.settings[2].touches.iter().filter(asked).count(), 1);
    }
}
