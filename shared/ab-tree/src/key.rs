//! Keys: the heap index of a node (root 1, children 2k and 2k + 1).
//!
//! Theorem 1 of the thesis: n faces fix the shape. A node of m faces gives the first ceil(m / 2) to
//! its left child, so leaves lie at depth ceil(log2 n) or one above.

/// Depth of a key; the root has depth 0.
#[inline]
#[must_use]
pub fn depth(key: u32) -> u32 {
    debug_assert!(key > 0);
    key.ilog2()
}

/// Key of the leaf of the face at `position` (0-based, in tree order) among `faces`.
#[must_use]
pub fn leaf_key(position: u32, faces: u32) -> u32 {
    assert!(position < faces, "a leaf beyond the last face");
    let (mut key, mut first, mut count) = (1u32, 0u32, faces);
    while count > 1 {
        let left = count.div_ceil(2);
        key *= 2;
        if position - first < left {
            count = left;
        } else {
            key += 1;
            first += left;
            count -= left;
        }
    }
    key
}

/// Faces below the node of a key in the tree over `faces` faces.
///
/// With the larger half on the left, child b gets ceil((n - b) / 2) faces. So a path b1 b2 .. bd
/// leads to ceil((n - (b1 + 2 b2 + 4 b3 + ..)) / 2^d) faces: n less the path read backwards.
#[inline]
fn faces_below(key: u32, faces: u32) -> u32 {
    let depth = depth(key);
    let path = u64::from(key) - (1 << depth);
    let backwards = if depth == 0 {
        0
    } else {
        path.reverse_bits() >> (64 - depth)
    };
    let rest = u64::from(faces).saturating_sub(backwards);
    rest.div_ceil(1 << depth) as u32
}

/// Whether a key is a leaf of the tree over `faces` faces.
#[inline]
#[must_use]
pub fn is_leaf_key(key: u32, faces: u32) -> bool {
    key != 0 && faces_below(key, faces) == 1 && (key == 1 || faces_below(key / 2, faces) > 1)
}

/// The deepest node above (or equal to) both keys.
#[inline]
#[must_use]
pub fn lowest_common_ancestor(a: u32, b: u32) -> u32 {
    let (da, db) = (depth(a), depth(b));
    let common = da.min(db);
    let (a, b) = (a >> (da - common), b >> (db - common));
    let differing = 32 - (a ^ b).leading_zeros();
    a >> differing
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_are_distinct_in_order_and_recognised_for_any_count() {
        for faces in 1..200u32 {
            let keys: Vec<u32> = (0..faces).map(|p| leaf_key(p, faces)).collect();
            // Left-aligned to one depth, the keys ascend: tree order is face order.
            let aligned: Vec<u64> = keys
                .iter()
                .map(|&k| u64::from(k) << (31 - depth(k)))
                .collect();
            assert!(aligned.windows(2).all(|w| w[0] < w[1]));
            let deepest = faces.next_power_of_two().ilog2();
            assert!(
                keys.iter()
                    .all(|&k| depth(k) + 1 >= deepest && depth(k) <= deepest)
            );
            let leaves = (0..2 * faces.next_power_of_two())
                .filter(|&k| is_leaf_key(k, faces))
                .count();
            assert_eq!(leaves as u32, faces);
            assert!(keys.iter().all(|&k| is_leaf_key(k, faces)));
        }
    }

    #[test]
    fn ancestors_agree_with_walking_up() {
        for a in 1..300u32 {
            for b in 1..300u32 {
                let (mut x, mut y) = (a, b);
                while x != y {
                    if x > y { x /= 2 } else { y /= 2 }
                }
                assert_eq!(lowest_common_ancestor(a, b), x);
            }
        }
    }
}
