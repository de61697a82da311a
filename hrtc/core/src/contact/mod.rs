//! Contact: queries on an active front, and the proxies that use them.
//!
//! | module | content |
//! |---|---|
//! | `query` | distance and intersection queries |
//! | `tool` | a rigid mesh as a probe, its trees, and its pairs with the front |
//! | `motion` | rigid motions and placements |
//! | `carried` | a point that a moving surface takes along |
//! | `coupling` | spring and damper between device and proxy |
//! | `sphere_proxy` | the proxy of a sphere, three degrees of freedom |
//! | `rigid_proxy` | the proxy of a tool, six degrees of freedom |

mod carried;
pub mod coupling;
pub mod motion;
pub mod query;
pub mod rigid_proxy;
pub mod sphere_proxy;
pub mod tool;
