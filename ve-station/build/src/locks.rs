//! Which copies of cut vertices stay where they are on every front.
//!
//! Locked ones are in every base mesh, two faces for each. So not more than [`MAX_LOCKED`] are; and
//! where there are more copies, the more there are the fewer are locked, spread over all cuts, and
//! of twice that number none.

use crate::tuning::input::MAX_LOCKED;

/// Which copies are locked: all, or of more than [`MAX_LOCKED`] one fewer for each of those beyond,
/// an even choice, in the file's order, of the places where they are. All copies of a place are
/// locked or none.
pub fn of_copies(copies: &[bool], positions: &[[f32; 3]]) -> Vec<bool> {
    let chosen = (0u32..).zip(copies).filter(|(_, copy)| **copy);
    let all: Vec<u32> = chosen.map(|(vertex, _)| vertex).collect();
    if all.len() <= MAX_LOCKED {
        return copies.to_vec();
    }
    let most = (2 * MAX_LOCKED).saturating_sub(all.len());
    let place = |vertex: u32| positions[vertex as usize].map(f32::to_bits);
    let mut by_place = all.clone();
    by_place.sort_unstable_by_key(|&vertex| (place(vertex), vertex));
    let mut groups: Vec<&[u32]> = by_place.chunk_by(|&a, &b| place(a) == place(b)).collect();
    groups.sort_unstable_by_key(|group| group[0]);
    let mut locked = vec![false; copies.len()];
    let (mut passed, mut count) = (0, 0);
    for group in groups {
        passed += group.len();
        // As many as are due among those so far.
        if count + group.len() <= passed * most / all.len() {
            count += group.len();
            for &vertex in group {
                locked[vertex as usize] = true;
            }
        }
    }
    locked
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_more_than_can_be_locked_unlocks_hardly_another() {
        let most = MAX_LOCKED;
        for pairs in [
            1,
            most / 2,
            most / 2 + 1,
            most / 2 + 100,
            most - 200,
            most,
            3 * most,
        ] {
            // Two copies at each place, and vertices between that are none.
            let positions: Vec<[f32; 3]> = (0..4 * pairs)
                .map(|k| [(k % (2 * pairs)) as f32, 0.0, 1.0])
                .collect();
            let copies: Vec<bool> = (0..4 * pairs).map(|k| k % 2 == 0).collect();
            let locked = of_copies(&copies, &positions);
            let count = locked.iter().filter(|&&locked| locked).count();
            let expected = most
                .min((2 * most).saturating_sub(2 * pairs))
                .min(2 * pairs);
            assert!(
                (count..count + 2).contains(&expected),
                "{count} of {}",
                2 * pairs
            );
            // Whole places, copies only, and no long stretch without one.
            let mut last = 0;
            for k in 0..2 * pairs {
                assert_eq!(locked[k], locked[k + 2 * pairs]);
                assert!(copies[k] || !locked[k]);
                if locked[k] {
                    assert!(
                        k - last <= 2 * ((2 * pairs).div_ceil(expected) + 1),
                        "{last} {k}"
                    );
                    last = k;
                }
            }
        }
    }
}
