//! Classes of things that are joined two by two: each names one above it, the root itself.

/// Root of the class of a thing, halving paths.
pub fn root(parent: &mut [u32], mut thing: u32) -> u32 {
    while parent[thing as usize] != thing {
        let above = parent[parent[thing as usize] as usize];
        parent[thing as usize] = above;
        thing = above;
    }
    thing
}

/// Makes one class of those of two things. The lower root stays one, so that the result does not
/// depend on the order of joins.
pub fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}
