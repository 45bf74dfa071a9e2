//! A Rust pose generator in its dynamic form, with the faults that a test asks for: `{"fault": "panic"}`.

use sfg_plugin::export::ExportPoseGenerator;
use sfg_plugin::{PluginContext, PluginError, PoseGenerator, PoseRequest};
use sfg_types::{PalmPoseCandidate, Pose, ScoreTerm, SynergyCoordinates};

/// Candidates along the key point's vertical, their number and the seed in the values, so that a test can tell what arrived.
#[derive(Debug)]
pub(crate) struct Tower {
    fault: String,
    seed: u64,
    n_calls: u32,
}

impl PoseGenerator for Tower {
    fn generate(&mut self, request: &PoseRequest<'_>, out: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
        self.n_calls += 1;
        match self.fault.as_str() {
            "panic" => panic!("the tower fell over at call {}", self.n_calls),
            "panic_with_a_number" => std::panic::panic_any(7),
            "fail" => return Err(PluginError::Failed { plugin: Self::NAME.to_owned(), message: "no stone left".to_owned() }),
            "too_many" => return Ok(out.len() + 1),
            _ => {}
        }
        if request.key_point.n_pixels == 0 {
            return Ok(0);
        }
        for (i, candidate) in out.iter_mut().enumerate() {
            let above = Pose::translation(0.0, 0.0, 0.1 + 0.01 * i as f64);
            candidate.base_from_palm = above * Pose::from(request.key_point.point_in_base.coords);
            candidate.hand_side = request.hand_side;
            candidate.stability = if self.fault == "nan" { f64::NAN } else { 1.0 / (1.0 + i as f64) };
            candidate.synergy = SynergyCoordinates::new(0.1 * f64::from(request.grasp_type.feix_number()) % 1.0, -0.3);
            candidate.terms = vec![ScoreTerm { name: "seed".to_owned(), value: self.seed as f64 }];
            if self.fault == "long_term" {
                candidate.terms[0].name = "x".repeat(40);
            }
        }
        Ok(out.len())
    }
}

impl Drop for Tower {
    fn drop(&mut self) {
        assert!(self.fault != "panic_in_drop", "the tower cannot be taken down");
    }
}

impl ExportPoseGenerator for Tower {
    const NAME: &'static str = "tower";

    fn make(context: &PluginContext<'_>) -> Result<Self, PluginError> {
        let fault = context.params["fault"].as_str().unwrap_or_default();
        assert!(fault != "panic_in_make", "no ground to build on");
        if context.params.get("height").is_some() {
            let message = "unknown parameter \"height\"".to_owned();
            return Err(PluginError::BadParameter { plugin: Self::NAME.to_owned(), message });
        }
        Ok(Self { fault: fault.to_owned(), seed: context.seed, n_calls: 0 })
    }
}

sfg_plugin::export_pose_generator!(Tower);
