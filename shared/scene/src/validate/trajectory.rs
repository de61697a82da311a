//! The trajectory of a probe: a scripted path (`tour`), or a CSV file of
//! `t,x,y,z[,qw,qx,qy,qz]`, seconds and metres in the world, time strictly increasing.
//!
//! Not the crate `csv`: its line numbers are wrong after blank and comment lines
//! (BurntSushi/rust-csv 208) and with CRLF (395), and every error here names its line.

use super::objects::Objects;
use crate::limits::{LENGTH_M, MAX_LENGTH_M, SPEED_M_PER_S};
use crate::plan::TrajectoryPlan;
use crate::source::{SceneError, Source, key};
use crate::typed::{TourTyped, TrajectoryTyped};
use geometry::Pose;
use toml::Spanned;

const COLUMNS: &str = "write t,x,y,z or t,x,y,z,qw,qx,qy,qz";

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
            .ok_or_else(|| format!("\"{field}\" is not a finite number"))?;
        count += 1;
    }
    Ok((numbers, count))
}

#[cfg(test)]
mod tests {
    use super::*;

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
