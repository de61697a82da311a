//! Trajectories as CSV: `t,x,y,z[,qw,qx,qy,qz]`, seconds and metres in the world, time strictly increasing.

use super::SceneError;
use geometry::Pose;

/// Reads the text of a trajectory; `shown` names the file in messages.
///
/// Empty lines and lines that start with `#` are passed over; one header line may come first.
pub(super) fn parse(text: &str, shown: &str) -> Result<Vec<(f64, Pose)>, SceneError> {
    let mut points: Vec<(f64, Pose)> = Vec::new();
    let mut header_allowed = true;
    for (index, line) in text.lines().enumerate() {
        let refuse =
            |sentence: &str| SceneError(format!("{shown}, line {}: {sentence}", index + 1));
        let line = line.trim_start_matches('\u{feff}').trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let first = std::mem::take(&mut header_allowed);
        if first && line.starts_with(|c: char| c.is_ascii_alphabetic()) && line.starts_with('t') {
            continue;
        }
        let mut numbers = [0.0_f64; 8];
        let mut count = 0;
        for field in line.split(',') {
            let field = field.trim();
            let Some(slot) = numbers.get_mut(count) else {
                return Err(refuse(
                    "more than eight columns; write t,x,y,z or t,x,y,z,qw,qx,qy,qz",
                ));
            };
            *slot = field
                .parse()
                .ok()
                .filter(|number: &f64| number.is_finite())
                .ok_or_else(|| refuse(&format!("\"{field}\" is not a finite number")))?;
            count += 1;
        }
        let [t, x, y, z, qw, qx, qy, qz] = numbers;
        let orientation = match count {
            4 => [1.0, 0.0, 0.0, 0.0],
            8 => [qw, qx, qy, qz],
            _ => {
                return Err(refuse(&format!(
                    "{count} columns; write t,x,y,z or t,x,y,z,qw,qx,qy,qz"
                )));
            }
        };
        if t < 0.0 {
            return Err(refuse(&format!(
                "time {t} is negative; start at 0 or later"
            )));
        }
        if let Some(&(before, _)) = points.last()
            && t <= before
        {
            return Err(refuse(&format!(
                "time {t} does not come after {before}; sort the points by strictly increasing seconds"
            )));
        }
        let pose = Pose::from_wxyz([x, y, z], orientation).ok_or_else(|| {
            refuse("the orientation qw,qx,qy,qz has no direction; write a quaternion, w first")
        })?;
        points.push((t, pose));
    }
    if points.is_empty() {
        return Err(SceneError(format!(
            "{shown}: no points; write lines of t,x,y,z (seconds and metres)"
        )));
    }
    Ok(points)
}
