//! The trajectory of a probe: a scripted path (`tour`), or a CSV file of
//! `t,x,y,z[,qw,qx,qy,qz]`, seconds and metres in the world, time strictly increasing.
//!
//! Not the crate `csv`: its line numbers are wrong after blank and comment lines
//! (BurntSushi/rust-csv 208) and with CRLF (395), and every error here names its line.

use super::objects::Objects;
use crate::limits::{LENGTH_M, MAX_LENGTH_M, MAX_TOUR_SIDES_PER_S, SPEED_M_PER_S};
use crate::plan::{ModelScale, ScenePlan, TrajectoryPlan};
use crate::source::{SceneError, Source, key};
use crate::typed::{ProbeTyped, TourTyped, TrajectoryTyped};
use geometry::Pose;
use toml::Spanned;

const COLUMNS: &str = "write t,x,y,z or t,x,y,z,qw,qx,qy,qz, with commas and decimal points";

/// Checks a trajectory; a CSV file is read.
pub(super) fn trajectory_plan(
    source: &Source,
    typed: Option<&TrajectoryTyped>,
    objects: &Objects,
) -> Result<TrajectoryPlan, SceneError> {
    match typed {
        None => tour_plan(source, &TourTyped::default(), objects),
        Some(TrajectoryTyped::Tour(tour)) => tour_plan(source, tour, objects),
        Some(TrajectoryTyped::Csv(file)) => csv_plan(source, file),
    }
}

fn tour_plan(
    source: &Source,
    typed: &TourTyped,
    objects: &Objects,
) -> Result<TrajectoryPlan, SceneError> {
    let object = match &typed.object {
        None => 0,
        Some(object) => objects.index(source, object)?,
    };
    let seed = source.number(key!(typed.seed), 1, 0..=i64::MAX)?;
    Ok(TrajectoryPlan::Tour {
        object,
        seed: seed.unsigned_abs(),
        speed_m_per_s: source.number(key!(typed.speed_m_per_s), 0.1, SPEED_M_PER_S)?,
        depth_m: source.number(key!(typed.depth_m), 0.002, LENGTH_M)?,
    })
}

/// Refuses tours that the station could not make: their object is smaller than they are deep, or
/// than the probe's tip, or they are too fast for it. The command line may have changed size and
/// speed; of an object in metres a unit only the station knows the size.
pub(super) fn check(
    source: &Source,
    typed: &[Spanned<ProbeTyped>],
    plan: &ScenePlan,
) -> Result<(), SceneError> {
    for (typed, probe) in typed.iter().zip(&plan.probes) {
        let TrajectoryPlan::Tour {
            object,
            depth_m,
            speed_m_per_s,
            ..
        } = probe.trajectory
        else {
            continue;
        };
        let ModelScale::Size(size_m) = plan.objects[object].scale else {
            continue;
        };
        let given = match &typed.get_ref().trajectory {
            Some(TrajectoryTyped::Tour(tour)) => Some(tour),
            _ => None,
        };
        let refuse = |given: Option<&Spanned<f64>>, sentence: &str| match given {
            Some(given) => source.value(given, sentence),
            None => source.value(typed, sentence),
        };
        if depth_m > size_m {
            let sentence = format!(
                "depth_m of the tour is {depth_m}, more than its object's size_m, {size_m}; write trajectory = {{ tour = {{ depth_m = ... }} }} with at most {size_m}, or a larger size_m"
            );
            let given = given.and_then(|tour| tour.depth_m.as_ref());
            return Err(refuse(given, &sentence));
        }
        let fastest = MAX_TOUR_SIDES_PER_S * size_m;
        if speed_m_per_s > fastest {
            let sentence = format!(
                "the tour goes at {speed_m_per_s} m/s, more than {MAX_TOUR_SIDES_PER_S} times its object's size_m, {size_m}, in a second; write speed_m_per_s (or --speed, which lies over it) with at most {fastest}, or a larger size_m"
            );
            let given = given.and_then(|tour| tour.speed_m_per_s.as_ref());
            return Err(refuse(given, &sentence));
        }
        let tip_m = probe.shape.tip_m();
        if tip_m > size_m {
            return Err(source.value(
                typed,
                &format!(
                    "the probe's tip has a radius of {tip_m} m, more than size_m of the object that its tour goes over, {size_m}; write a smaller probe, a larger size_m, or a path with trajectory = {{ csv = \"FILE\" }}"
                ),
            ));
        }
    }
    Ok(())
}

fn csv_plan(source: &Source, file: &Spanned<String>) -> Result<TrajectoryPlan, SceneError> {
    let path = source.path(file);
    let shown = path.display();
    let text = source.read_text(&path).map_err(|error| {
        source.value(file, &format!("the trajectory {shown} cannot be read ({error}); name a CSV file relative to the scene"))
    })?;
    Ok(TrajectoryPlan::Points(points(&text, &shown.to_string())?))
}

/// Reads the text of a trajectory; `shown` names the file in messages.
///
/// Empty lines and lines that start with `#` are skipped; one header line may come first.
fn points(text: &str, shown: &str) -> Result<Vec<(f64, Pose)>, SceneError> {
    let mut points: Vec<(f64, Pose)> = Vec::new();
    let mut header_allowed = true;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim_start_matches('\u{feff}').trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        if std::mem::take(&mut header_allowed) && line.starts_with('t') {
            continue;
        }
        let before = points.last().map(|&(t, _)| t);
        let point = point(line, before)
            .map_err(|sentence| SceneError(format!("{shown}, line {}: {sentence}", index + 1)))?;
        points.push(point);
    }
    if points.is_empty() {
        return Err(SceneError(format!(
            "{shown}: no points; write lines of t,x,y,z (seconds and metres)"
        )));
    }
    Ok(points)
}

/// Reads one point; `before` is the time of the point before it.
fn point(line: &str, before: Option<f64>) -> Result<(f64, Pose), String> {
    let (numbers, count) = columns(line)?;
    let [t, x, y, z, qw, qx, qy, qz] = numbers;
    let orientation = match count {
        4 => [1.0, 0.0, 0.0, 0.0],
        8 => [qw, qx, qy, qz],
        _ => return Err(format!("{count} columns; {COLUMNS}")),
    };
    if t < 0.0 {
        return Err(format!("time {t} is negative; start at 0 or later"));
    }
    if let Some(before) = before
        && t <= before
    {
        return Err(format!(
            "time {t} does not come after {before}; sort the points by strictly increasing seconds"
        ));
    }
    if let Some(far) = [x, y, z].into_iter().find(|x| x.abs() > MAX_LENGTH_M) {
        return Err(format!(
            "{far:e} m is too far away; write x, y and z in metres, none larger than {MAX_LENGTH_M}"
        ));
    }
    let pose = Pose::from_wxyz([x, y, z], orientation)
        .ok_or("the orientation qw,qx,qy,qz has no direction; write a quaternion, w first")?;
    Ok((t, pose))
}

/// The numbers of a line, and their count.
fn columns(line: &str) -> Result<([f64; 8], usize), String> {
    let mut numbers = [0.0_f64; 8];
    let mut count = 0;
    for field in line.split(',') {
        let field = field.trim();
        let slot = numbers
            .get_mut(count)
            .ok_or_else(|| format!("more than eight columns; {COLUMNS}"))?;
        *slot = field
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .ok_or_else(|| format!("\"{field}\" is not a finite number; {COLUMNS}"))?;
        count += 1;
    }
    Ok((numbers, count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NoFiles, Overrides, parse};
    use std::path::Path;

    /// The default tour is 2 mm deep, the default probe a ball of 1 mm.
    #[test]
    fn a_tour_that_its_object_is_too_small_for_is_refused_with_its_line() {
        let plan = |size: &str, probe: &str, size_m: Option<f64>| {
            let text = format!("[[object]]\nmodel = \"m.spm\"\n{size}\n[[probe]]\n{probe}\n");
            let overrides = Overrides {
                size_m,
                ..Overrides::default()
            };
            parse(&text, "s", Path::new(""), &overrides, &NoFiles)
        };
        let deep = "trajectory = { tour = { depth_m = 0.2 } }";
        let shallow = "trajectory = { tour = { depth_m = 0.0001, speed_m_per_s = 0.01 } }";
        let slow = "trajectory = { tour = { speed_m_per_s = 0.04 } }";
        let ball = "shape = { sphere = { radius_m = 0.2 } }";
        let of_tip = "line 4: the probe's tip has a radius of";
        for (size, probe, given, says) in [
            (
                "size_m = 0.0015",
                "",
                None,
                "line 4: depth_m of the tour is 0.002, more",
            ),
            (
                "size_m = 0.1",
                deep,
                None,
                "line 5: depth_m of the tour is 0.2, more",
            ),
            (
                "metres_per_unit = 1",
                "",
                Some(0.001),
                "with at most 0.001, or",
            ),
            ("size_m = 0.0005", shallow, None, of_tip),
            ("size_m = 0.1", ball, None, of_tip),
            ("size_m = 1", ball, Some(0.1), of_tip),
        ] {
            let refused = plan(size, probe, given).unwrap_err().0;
            assert!(refused.contains(says), "{size} {probe}: {refused}");
        }
        let fast = "trajectory = { tour = { speed_m_per_s = 2.5 } }";
        let refused = plan("size_m = 0.1", fast, None).unwrap_err().0;
        for says in ["line 5: the tour goes at 2.5 m/s", "with at most 2, or"] {
            assert!(refused.contains(says), "{refused}");
        }
        for (size, probe, given) in [
            ("size_m = 0.1", fast, Some(0.125)),
            ("metres_per_unit = 0.001", fast, None),
            ("size_m = 0.002", slow, None),
            ("size_m = 0.001", shallow, None),
            ("size_m = 0.0015", deep, Some(0.2)),
            // How large it is only the station knows.
            ("metres_per_unit = 0.001", ball, None),
            // Nothing leads a custom device.
            (
                "size_m = 0.0005",
                "device = { custom = { name = \"mine\" } }",
                None,
            ),
        ] {
            let plan = plan(size, probe, given);
            assert!(plan.is_ok(), "{size} {probe}: {plan:?}");
        }
    }

    #[test]
    fn a_line_of_other_separators_is_told_which_there_are() {
        for line in ["0;0;0;0", "0 0 0 0", "0,\"0,1\",0,0"] {
            let refused = points(line, "path.csv").unwrap_err().0;
            assert!(refused.starts_with("path.csv, line 1:"), "{refused}");
            assert!(
                refused.ends_with("with commas and decimal points"),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_place_beyond_the_longest_length_is_refused_with_its_line() {
        for place in ["1.1e7,0,0", "0,-1e300,0", "0,0,1e8,1,0,0,0"] {
            let text = format!("0,0,0,0\n1,{place}\n");
            let refused = points(&text, "path.csv").unwrap_err().0;
            assert!(
                refused.starts_with("path.csv, line 2:") && refused.contains("too far away"),
                "{refused}"
            );
        }
        assert!(points("0,1e7,0,-1e7\n", "path.csv").is_ok());
    }
}
