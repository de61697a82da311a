//! The layout of the viewer: space beside the curves; nothing needs a click.

use super::series::{PLOTS, Plot};
use super::shapes::point;
use super::touch::NEAR_EYE;
use glam::DVec3;
use rerun::blueprint::components::PanelState;
use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel,
    Spatial3DView, TextDocumentView, TimePanel, TimeSeriesView, Vertical,
};
use rerun::external::re_sdk_types::blueprint::archetypes::{EyeControls3D, PlotLegend};
use rerun::log::{Chunk, LogMsg};
use rerun::{
    AsComponents, RecordingStream, RecordingStreamBuilder, RecordingStreamResult, StoreId,
    TextDocument, ViewCoordinates,
};

/// Widths of space and of the curves.
const COLUMNS: [f32; 2] = [5.0, 3.0];
/// Height of a plot of several curves, in those of one: its legend lies over it.
const SEVERAL: f32 = 1.5;
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
    let heights = PLOTS.map(|plot| if plot.has_one() { 1.0 } else { SEVERAL });
    let columns: [ContainerLike; 2] = [
        Vertical::new(space).with_row_shares(ROWS).into(),
        Vertical::new(plots).with_row_shares(heights).into(),
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
    let mut views = vec![ViewProperty::eye(NEAR, &NEAR_EYE)];
    views.extend(eye.map(|eye| ViewProperty::eye(SCENE, &eye)));
    let alone = PLOTS.into_iter().filter(Plot::has_one);
    views.extend(alone.map(|plot| ViewProperty::no_legend(plot.title)));
    send_with(stream, &blueprint, &views)
}

/// A property of a view.
struct ViewProperty {
    /// Of the view with this title.
    title: &'static str,
    /// Its entity below that of the view.
    entity: &'static str,
    value: Box<dyn AsComponents>,
}

impl ViewProperty {
    /// From where a view of space is seen.
    fn eye(title: &'static str, eye: &Eye) -> Self {
        let controls = EyeControls3D::new()
            .with_position(point(eye.position))
            .with_look_target(point(eye.target))
            .with_eye_up(point(eye.up));
        Self {
            title,
            entity: "EyeControls3D",
            value: Box::new(controls),
        }
    }

    /// Of a plot whose title says what its curve is.
    fn no_legend(title: &'static str) -> Self {
        Self {
            title,
            entity: "PlotLegend",
            value: Box::new(PlotLegend::new().with_visible(false)),
        }
    }
}

/// Sends a blueprint with properties of its views. The interface of rerun 0.36 has none, so they
/// are added to the blueprint's messages, before the one that ends them.
fn send_with(
    stream: &RecordingStream,
    blueprint: &Blueprint,
    properties: &[ViewProperty],
) -> RecordingStreamResult<()> {
    let (staged, messages) = RecordingStreamBuilder::new(super::APPLICATION).memory()?;
    blueprint.send(&staged, BlueprintActivation::default())?;
    let mut found = Vec::new();
    for message in messages.take() {
        match &message {
            LogMsg::ArrowMsg(store, arrow) if store.is_blueprint() => {
                let chunk = Chunk::from_arrow_msg(arrow)?;
                let words = chunk.to_string();
                let of_view = properties.iter().filter(|of| words.contains(of.title));
                found.extend(of_view.map(|of| (chunk.entity_path().clone(), of)));
            }
            LogMsg::BlueprintActivationCommand(command) => {
                for (view, property) in &found {
                    let entity = format!("{view}/{}", property.entity);
                    send_property(stream, &command.blueprint_id, entity, &*property.value)?;
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

fn send_property(
    stream: &RecordingStream,
    id: &StoreId,
    entity: String,
    value: &dyn AsComponents,
) -> RecordingStreamResult<()> {
    let (staged, messages) = RecordingStreamBuilder::from_store_id(id).memory()?;
    staged.set_time_sequence("blueprint", 0);
    staged.log(entity, value)?;
    let all = messages.take().into_iter();
    let shown = all.filter(|of| matches!(of, LogMsg::ArrowMsg(..)));
    shown.for_each(|message| stream.record_msg(message));
    Ok(())
}
