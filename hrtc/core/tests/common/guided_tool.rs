//! A tool and its proxy, for the tests that lead one over a front.
#![allow(dead_code, reason = "every test file uses another part")]

use super::fronts::{Front, frame};
use hrtc_core::contact::query::first_pair;
use hrtc_core::contact::rigid_proxy::ToolProxy;
use hrtc_core::contact::tool::{Tool, ToolMesh};

/// Pairs of nodes, 12 a unit: nearly twice as many units as a tick of a tool has time for, some
/// 2300 by `WorkCosts::REFERENCE`, so that a step is not cut short.
pub const TICK_BUDGET: u32 = 12 * 4096;

/// A quarter of it: less than half of what a tick has time for.
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
