//! The layout of the viewer: space beside the curves; nothing needs a click.

use super::series::PLOTS;
use super::shapes::point;
use super::touch::NEAR_EYE;
use glam::DVec3;
use rerun::blueprint::components::PanelState;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel,
    Spatial3DView, TextDocumentView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::EyeControls3D;
use rerun::log::{Chunk, LogMsg};
use rerun::{
    RecordingStream, RecordingStreamBuilder, RecordingStreamResult, StoreId, TextDocument,
    ViewCoordinates,
};

/// Widths of space and of the curves.
const COLUMNS: [f32; 2] = [5.0, 3.0];
/// Heights of the touch, of the whole scene and of the legend.
const ROWS: [f32; 3] = [10.0, 8.0, 3.0];
/// Titles of both views of space.
const NEAR: &str = "The touch from near, its normal upwards";
const SCENE: &str = "The scene";
/// Colours and what they mean.
const LEGEND: &str = "\
**orange** faces: original, without error · **yellow**: refined, the paler the larger the \
certified error · **blue**: base mesh\n\n\
**red**: the device (a tool: lines) · **green** lines: the proxy, held outside · **white** arrow: \
force on the hand · **blue** arrows: normals of the contacts\n\n\
boxes: cells of the mesh that were asked for ahead (**grey**), that a touch is predicted in \
(**orange**)";

/// From where a view of space is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Where it is.
    pub position: DVec3,
    /// What it looks at.
    pub target: DVec3,
    /// Upwards in the picture.
    pub up: DVec3,
}

/// Sends the layout and what never changes, in place of an earlier one; where no eye is given, the
/// viewer finds one for the scene.
///
/// # Errors
/// When the stream refuses.
pub fn send(stream: &RecordingStream, eye: Option<Eye>) -> RecordingStreamResult<()> {
    stream.log_static("legend", &TextDocument::from_markdown(LEGEND))?;
    for root in [super::WORLD, super::TOUCH] {
        stream.log_static(root, &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    }
    let space: [ContainerLike; 3] = [
        Spatial3DView::new(NEAR).with_origin(super::TOUCH).into(),
        Spatial3DView::new(SCENE).with_origin(super::WORLD).into(),
        TextDocumentView::new("Colours")
            .with_origin("legend")
            .into(),
    ];
    let plots = PLOTS.map(|plot| {
        let view = TimeSeriesView::new(plot.title);
        view.with_origin(format!("plots/{}", plot.entity)).into()
    });
    let columns: [ContainerLike; 2] = [
        Vertical::new(space).with_row_shares(ROWS).into(),
        Vertical::new(plots).into(),
    ];
    let hidden = PanelState::Hidden;
    let blueprint = Blueprint::new(Horizontal::new(columns).with_column_shares(COLUMNS))
        .with_blueprint_panel(BlueprintPanel::from_state(hidden))
        .with_selection_panel(SelectionPanel::from_state(hidden))
        .with_time_panel(
            TimePanel::new()
                .with_state(PanelState::Collapsed)
                .with_timeline(super::TIMELINE),
        );
    send_with_eyes(stream, &blueprint, &[(NEAR, Some(NEAR_EYE)), (SCENE, eye)])
}

/// Sends a blueprint with cameras of the views with these titles. The interface of rerun 0.36 has
/// none, so they are added to the blueprint's messages, before the one that ends them.
fn send_with_eyes(
    stream: &RecordingStream,
    blueprint: &Blueprint,
    eyes: &[(&str, Option<Eye>)],
) -> RecordingStreamResult<()> {
    let (staged, messages) = RecordingStreamBuilder::new(super::APPLICATION).memory()?;
    blueprint.send(&staged, BlueprintActivation::default())?;
    let mut found = Vec::new();
    for message in messages.take() {
        match &message {
            LogMsg::ArrowMsg(store, arrow) if store.is_blueprint() => {
                let chunk = Chunk::from_arrow_msg(arrow)?;
                let words = chunk.to_string();
                let eye = eyes.iter().find(|(title, _)| words.contains(title));
                found.extend(eye.and_then(|of| Some((chunk.entity_path().clone(), of.1?))));
            }
            LogMsg::BlueprintActivationCommand(command) => {
                for (view, eye) in &found {
                    send_eye(stream, &command.blueprint_id, &view.to_string(), eye)?;
                }
            }
            message if message.store_id().is_blueprint() => {}
            // Of the recording that staged it.
            _ => continue,
        }
        stream.record_msg(message);
    }
    Ok(())
}

fn send_eye(
    stream: &RecordingStream,
    id: &StoreId,
    view: &str,
    eye: &Eye,
) -> RecordingStreamResult<()> {
    let (staged, messages) = RecordingStreamBuilder::from_store_id(id).memory()?;
    staged.set_time_sequence("blueprint", 0);
    let controls = EyeControls3D::new()
        .with_position(point(eye.position))
        .with_look_target(point(eye.target))
        .with_eye_up(point(eye.up));
    staged.log(format!("{view}/EyeControls3D"), &controls)?;
    let all = messages.take().into_iter();
    let shown = all.filter(|of| matches!(of, LogMsg::ArrowMsg(..)));
    shown.for_each(|message| stream.record_msg(message));
    Ok(())
}
