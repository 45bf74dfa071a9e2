//! Step 2: one RGB-D image of each camera.

use crate::context::{SkillContext, SkillFailure, StageNote, hash_bytes};
use sfg_tree::{PortSpec, Registry};
use sfg_types::{FailureReason, Observation};
use std::sync::Arc;

/// Share of pixels that must have a depth for a view to be of use.
const MIN_DEPTH_SHARE: f64 = 0.05;

/// `observation` when every view is usable.
///
/// # Errors
/// [`FailureReason::NoView`] when there is no view or one is blind.
pub fn usable_observation(observation: Observation) -> Result<Observation, SkillFailure> {
    if observation.views.is_empty() {
        return Err(SkillFailure::new(FailureReason::NoView, "the driver returned no image"));
    }
    for view in &observation.views {
        let n_pixels = view.intrinsics.width * view.intrinsics.height;
        if view.depth_m.len() != n_pixels || view.rgb.len() != 3 * n_pixels {
            return Err(SkillFailure::new(
                FailureReason::NoView,
                format!("camera {:?} returned an image of the wrong size", view.camera),
            ));
        }
        let n_returns = view.depth_m.iter().filter(|depth| depth.is_finite() && **depth > 0.0).count();
        if (n_returns as f64) < MIN_DEPTH_SHARE * n_pixels as f64 {
            return Err(SkillFailure::new(
                FailureReason::NoView,
                format!("camera {:?} sees depth at {n_returns} of {n_pixels} pixels only", view.camera),
            ));
        }
    }
    Ok(observation)
}

/// SHA-256 over the pixels of all views.
#[must_use]
pub fn hash_observation(observation: &Observation) -> String {
    let mut bytes = Vec::new();
    for view in &observation.views {
        bytes.extend_from_slice(&view.rgb);
        bytes.extend(view.depth_m.iter().flat_map(|depth| depth.to_le_bytes()));
    }
    hash_bytes(&bytes)
}

/// `observe_scene`: Success with `observation` written, Failure `no_view` or `driver_failed`. Never Running.
pub fn register(registry: &mut Registry<SkillContext>) {
    let ports = [PortSpec::output::<Observation>("observation").default_key("observation").doc("one RGB-D image a camera")];
    registry
        .step("observe_scene", ports, |tick| {
            let outcome = tick.context.robot.observe().and_then(usable_observation).map(|observation| {
                let n_returns: usize =
                    observation.views.iter().map(|view| view.depth_m.iter().filter(|depth| **depth > 0.0).count()).sum();
                let n_pixels: usize = observation.views.iter().map(|view| view.depth_m.len()).sum();
                let share = 100.0 * n_returns as f64 / n_pixels as f64;
                let note = StageNote {
                    summary: format!("{} views, {share:.0} % of the pixels have depth", observation.views.len()),
                    input_sha256: hash_observation(&observation),
                    details: serde_json::json!({
                        "cameras": observation.views.iter().map(|view| view.camera.clone()).collect::<Vec<_>>(),
                        "depth_percent": share,
                    }),
                };
                (observation, note)
            });
            let observation = Arc::new(tick.context.finish_stage("observe_scene", outcome)?);
            tick.context.kept.observation.get_or_insert_with(|| Arc::clone(&observation));
            tick.context.kept.last_observation = Some(Arc::clone(&observation));
            tick.set_shared("observation", observation);
            Ok(())
        })
        .fails_with([FailureReason::NoView].map(FailureReason::name));
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use sfg_types::{CameraIntrinsics, Pose, RgbdImage};

    fn view(depth_m: Vec<f32>) -> RgbdImage {
        let intrinsics = CameraIntrinsics { width: 10, height: 2, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        RgbdImage { camera: "right".into(), intrinsics, base_from_camera: Pose::identity(), rgb: vec![0; 60], depth_m }
    }

    #[track_caller]
    fn check(views: Vec<RgbdImage>, expected: Option<&str>) {
        let outcome = usable_observation(Observation { views, stamp_secs: 0.0 });
        match expected {
            None => assert!(outcome.is_ok()),
            Some(text) => {
                let failure = outcome.unwrap_err();
                assert_eq!(failure.reason, FailureReason::NoView);
                assert!(failure.explanation.contains(text), "{}", failure.explanation);
            }
        }
    }

    #[test]
    fn blind_missing_and_truncated_views_are_refused() {
        check(vec![view(vec![1.0; 20])], None);
        check(vec![], Some("no image"));
        check(vec![view(vec![0.0; 20])], Some("0 of 20"));
        check(vec![view(vec![f32::NAN; 20])], Some("0 of 20"));
        check(vec![view(vec![1.0; 19])], Some("wrong size"));
    }
}
