//! A tool and its proxy, for the tests that lead one over a front.
#![allow(dead_code, reason = "every test file uses another part")]

use super::fronts::{Front, frame};
use hrtc_core::contact::query::first_pair;
use hrtc_core::contact::rigid_proxy::ToolProxy;
use hrtc_core::contact::tool::{Tool, ToolMesh};

/// Pairs of nodes that a tick has time for on one tool: 12 a unit of 4096 units of work, which take
/// 0.6 ms on the reference machine.
pub const TICK_BUDGET: u32 = 12 * 4096;

/// The same in a tick whose other work leaves the least, 1024 units.
pub const MIN_TICK_BUDGET: u32 = 12 * 1024;

/// A proxy, and the same tool to ask with.
pub struct GuidedTool {
    pub proxy: ToolProxy,
    tool: Tool,
    pub mesh: ToolMesh,
}

impl GuidedTool {
    /// Not placed yet, a unit of the tool being one of the model.
    pub fn new(mesh: ToolMesh) -> Self {
        let tool = Tool::new(&mesh).expect("it is a tool");
        let proxy = ToolProxy::new(tool.clone(), 1.0).expect("it has an extent");
        Self { proxy, tool, mesh }
    }

    /// Whether a face of it meets the surface, by a search of all.
    pub fn meets(&mut self, front: &Front) -> bool {
        let at = self.proxy.pose();
        self.tool.place(&frame(at.position, at.orientation, 1.0));
        first_pair(&front.surface(), &self.tool, u32::MAX, None)
            .0
            .is_some()
    }
}
