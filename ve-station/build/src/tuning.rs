//! Tuning constants of the builder, a module a room: each with its unit and why it has its value.
//! Numbers of the file formats stand beside their readers and writers.

/// Reading and cleaning a mesh.
pub mod input {
    /// A facet of an STL that is smaller than so many steps of an f32 at the model's size is one of
    /// a model that something stray makes seem large: its corners are not rounded to such steps. A
    /// corner of the smallest that are is moved, where it is compared, by a 256th of it.
    pub const FINE_FACET_STEPS: f32 = 256.0;
    /// Polygons of more corners that are no fan are refused: cutting ears takes time in the square.
    pub const MAX_CORNERS: usize = 8192;
    /// The part of its area by which the fan of a larger polygon may fold over, from rounding: that
    /// of a disk of 10 000 corners does so by 5e-5 in a text of four digits.
    pub const MAX_FOLDED: f64 = 1e-4;
    /// A model whose centre lies farther from its own origin than this many of its diagonals gets
    /// another origin: six of the 24 bits of an f32 would be lost to the distance.
    pub const FAR_DIAGONALS: f64 = 64.0;
    /// Sides at one edge that are matched; more than so many are all cut.
    pub const MAX_MATCHED: usize = 32;
    /// The most copies of cut vertices that are locked: some 8000 faces of a base mesh, half a
    /// mebibyte of the controller's cache.
    pub const MAX_LOCKED: usize = 4096;
}

/// Simplification.
pub mod simplify {
    /// The most faces round a vertex that a collapse makes: bounds the work of a split.
    pub const MAX_FACES_ROUND_A_VERTEX: usize = 24;
    /// A face may not turn by more than this, as a cosine.
    pub const MIN_TURN_COSINE: f64 = 0.2;
    /// A face may not shrink below this share of its area.
    pub const MIN_AREA_SHARE: f64 = 1e-14;
    /// Weight of the planes that hold boundaries in place, against that of a face as large as its
    /// edge squared.
    pub const BOUNDARY_WEIGHT: f64 = 100.0;
    /// Cost of length squared, which orders edges on planes; in the frame in which the diagonal is
    /// one.
    pub const LENGTH_COST: f64 = 1e-12;
    /// Faces whose edges one task weighs.
    pub const FACES_A_TASK: usize = 4096;
    /// The longest chain of collapses that depend on each other, at least.
    pub const SHORTEST_LIMIT_OF_CHAINS: f64 = 40.0;
    /// And for each halving of the vertices. (Rounds make 3 to 3.5; a lake that loses more than its
    /// share makes more, and keeps some vertices for it.)
    pub const CHAIN_A_HALVING: f64 = 4.0;
    /// Faces round an end of an edge beyond which its collapse makes too large a fan whatever the
    /// other end: that has two at least, and four go (at a boundary: one, and two).
    pub const MAX_FACES_ROUND_AN_END: u32 = MAX_FACES_ROUND_A_VERTEX as u32 + 2;
}

/// The errors of a model.
pub mod error {
    /// Steps of a grid: at least, at most, and for each square root of vertices that hang on the
    /// face.
    pub const STEPS: (f64, f64, f64) = (4.0, 64.0, 2.0);
    /// The most faces of a walk: beyond, boxes are faster.
    pub const MAX_STEPS: usize = 12;
    /// The most faces that a search looks at, so that none grows with a fan: three times what any
    /// search needed in `cargo test -p ve-station --test builder expected_error` (291, of 3050
    /// faces).
    pub const MAX_FACES: u32 = 1024;
}

/// Regions, and the order of faces.
pub mod regions {
    /// Faces that one task puts into regions.
    pub const FACES_A_TASK: usize = 1 << 14;
    /// The most faces that an occupied region should own at median: about 128. Halving the cells
    /// divides it by three to four, so 40 to 140 come out; larger regions refine what the probe
    /// never touches (the dragon with 156 took twice the splits a tick that it takes with 42).
    pub const FACES_A_REGION: f64 = 140.0;
    /// The most faces of the region in which the median face lies. Where faces are even that region
    /// is near the median one, and the grid stays; what has most of the faces and stands on a large
    /// floor gets regions of its own size. Four: what halving the cells of a surface divides by.
    pub const TYPICAL_FACES: f64 = 4.0 * FACES_A_REGION;
    /// The most faces of the region up to which 95 % of the pairs of face and region are: an object
    /// on a floor of many triangles has less than half of all faces, and is shared out too, as far
    /// as [`MIN_FACES_A_REGION`] goes. Sixteen: three times what most models of even triangles have
    /// (terrain, torus, dragon, gear: 86 to 671), so their grids stay, and a closure of it still
    /// fits into a cache many times.
    pub const CROWDED_FACES: f64 = 16.0 * FACES_A_REGION;
    /// The fewest faces that a region owns at mean where a finer grid is taken for a crowd alone.
    /// Below, a touch of the floor meets more cells than can be asked for; an object smaller than a
    /// cell, or a fan round one corner, is helped by no grid.
    pub const MIN_FACES_A_REGION: usize = 4;
    /// The most cells that a face may overlap at mean: many times the two of scans and shapes of
    /// even triangles. Where all are long slivers, as those round the middle of a cylinder's cap,
    /// cells half as large own half as many faces, but each face is in twice as many cells: what
    /// they own together would grow with the square of the fan.
    pub const CELLS_A_FACE: usize = 32;
    /// A mean that is so many times the wanted median belongs to no grid that comes near it.
    pub const SURELY_TOO_MANY: f64 = 64.0;
    /// Regions that are searched between two reports of progress.
    pub const REGIONS_A_BATCH: usize = 4096;
    /// Regions that a search takes at a time.
    pub const REGIONS_A_TURN: usize = 32;
    /// The most searches at once: each has 8 B a VSP of its own.
    pub const MAX_SEARCHES: usize = 8;
    /// Sets of faces below this size are split without another task.
    pub const FACES_A_BRANCH: usize = 1 << 14;
}

/// The size of a file.
pub mod write {
    /// Bytes of an SPM file for each face of its mesh at the most, with the regions of the default.
    /// Closed surfaces need 70 to 82, strips and separate triangles more: the test
    /// `no_file_is_longer_than_its_bound` prints what it measures. (Only slivers and large
    /// faces that cross many cells each need more, 177 of a cylinder with 12 000 faces round each
    /// cap's middle; of those a full disk is told when they are written.)
    pub const MAX_BYTES_A_FACE: u64 = 160;
    /// Bytes of an SPM file beside that at the most: header, and whole blocks.
    pub const MAX_BYTES_BESIDE: u64 = 16 << 10;
}

/// The close bound of fronts.
pub mod close {
    /// How far a foot is moved from the nearest point towards the middle of its face, so that it
    /// lies inside: a millionth adds nothing that is seen in a bound, and is far beyond rounding.
    pub const INWARDS: f64 = 1.0 / (1 << 20) as f64;
    /// The most sides of a rim, each way, from a child's foot to its parent's.
    pub const BOUNDARY_STEPS: usize = 64;
    /// Faces that a trace crosses at the most: so many, and for each descendant of its ends so many
    /// more. (It crosses about the square root of their faces; what crosses more goes elsewhere.)
    pub const MAX_STEPS: (usize, usize) = (32, 2);
    /// How far a trace may stray from its edge, in R of its ends: beyond, the bound is R.
    pub const LIMIT_OF_RADIUS: f64 = 2.0;
    /// And, since the full mesh's vertices have none, in squares of its length.
    pub const LIMIT_OF_EDGE: f64 = 0.25;
    /// The part of that limit, squared, at which no better trace is looked for.
    pub const GOOD: f64 = 1.0 / 64.0;
    /// Vertices of a patch: so many, and for each descendant of its corners so many more. (A patch
    /// has about as many as its corners have descendants; what has far more has leaked.)
    pub const PATCH: (usize, usize) = (64, 2);
    /// Faces of the full mesh that one task takes through all fronts: their edges are traced once.
    /// Four times as many leave a small mesh too few tasks to share out evenly.
    pub const FACES_A_TASK: usize = 512;
}

/// The bounds of the quarters of faces.
pub mod quarters {
    /// Faces of the full mesh for each face whose quarters get bounds: a table of 12 B each is 4 %
    /// of the file.
    pub const FACES_A_BOUND: usize = 4;
    /// Faces whose parts get bounds for each that gets into the table: four give the same figures.
    pub const LARGE: usize = 2;
    /// Times that a face is cut in four: a third one takes up to a sixth more of a build and gives
    /// about the same figures (`rt-tests accuracy`, cow, fandisk, bunny20k, dragon25k).
    pub const DEPTH: u32 = 2;
    const _: () = assert!(DEPTH <= spm::QuarteredFace::MAX_DEPTH);
    /// One in so many splits is left in the finest front that is looked at: in finer ones the faces
    /// are small, and their corners say enough.
    pub const LEFT: usize = 16;
    /// Octaves beyond which a bound of a face's own tells no more.
    pub const MAX_OCTAVES: f64 = 4.0;
    /// Faces that one task goes through.
    pub const FACES_A_TASK: usize = 4096;
}
