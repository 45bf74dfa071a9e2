//! A pose generator in a library, behind the contract's trait.

#![expect(unsafe_code, reason = "the host's side of the C boundary")]

use crate::library::{PoseGeneratorFactory, with_message};
use sfg_plugin::views::{self, HandLent, RequestLent};
use sfg_plugin::{PluginContext, PluginError, PoseGenerator, PoseRequest, abi};
use sfg_types::PalmPoseCandidate;
use std::ptr;

/// A [`PoseGenerator`] whose work is done by a library.
///
/// Every value that comes back is checked. After a panic in the plugin, an unknown status or a claim of more candidates than
/// there was room for, the instance is retired: every later call fails, and the instance is left as it is.
#[derive(Debug)]
pub struct DynamicPoseGenerator {
    factory: PoseGeneratorFactory,
    instance: *mut abi::Instance,
    /// Why the instance is not used any more.
    retired: Option<String>,
    buffer: Vec<abi::PalmPose>,
}

// SAFETY: the boundary allows calls on any thread, one at a time; `&mut self` gives the one at a time.
unsafe impl Send for DynamicPoseGenerator {}

impl DynamicPoseGenerator {
    /// Makes an instance in the library.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] or [`PluginError::Failed`] with the plugin's own message; the latter also when the scenario
    /// folder is not UTF-8 or the library breaks the rules of the boundary.
    pub fn new(factory: &PoseGeneratorFactory, context: &PluginContext<'_>) -> Result<Self, PluginError> {
        let failed = |message: String| PluginError::Failed { plugin: factory.name().to_owned(), message };
        let Some(scenarios_dir) = context.scenarios_dir.to_str() else {
            return Err(failed(format!("the scenario folder {:?} is not UTF-8", context.scenarios_dir)));
        };
        let params = context.params.to_string();
        let hand_lent = HandLent::new(context.hand);
        let hand = hand_lent.view();
        let config = views::config_view(context, &params, scenarios_dir, &raw const hand);
        let mut instance = ptr::null_mut();
        // SAFETY: obligations 1 and 2 of `PoseGeneratorTable::create`: all of it lives until return.
        let (status, message) =
            with_message(|error| unsafe { (factory.table.create)(&raw const config, &raw mut instance, error) });
        match status {
            abi::status::OK if instance.is_null() => Err(failed("it made no instance and reported success".to_owned())),
            abi::status::OK => Ok(Self { factory: factory.clone(), instance, retired: None, buffer: Vec::new() }),
            abi::status::BAD_PARAMETER => Err(PluginError::BadParameter { plugin: factory.name().to_owned(), message }),
            abi::status::FAILED => Err(failed(message)),
            abi::status::PANICKED => Err(failed(format!("it panicked: {message}"))),
            unknown => Err(failed(format!("it returned the unknown status {unknown}"))),
        }
    }

    fn failed(&self, message: impl Into<String>) -> PluginError {
        PluginError::Failed { plugin: self.factory.name().to_owned(), message: message.into() }
    }

    fn retire(&mut self, why: String) -> PluginError {
        let error = self.failed(why.clone());
        self.retired = Some(why);
        error
    }
}

impl PoseGenerator for DynamicPoseGenerator {
    fn generate(&mut self, request: &PoseRequest<'_>, out: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
        if let Some(why) = &self.retired {
            return Err(self.failed(format!("it is not used any more: {why}")));
        }
        let hand = HandLent::new(request.hand);
        let lent = RequestLent::new(request, &hand);
        let view = lent.view();
        let capacity = out.len();
        self.buffer.clear();
        self.buffer.resize(capacity, abi::PalmPose::UNSET);
        let mut written = 0;
        let generate = self.factory.table.generate;
        // SAFETY: obligations 1 to 4 of `PoseGeneratorTable::generate`: the instance came from `create` and is not retired,
        // `lent` keeps what the request points to, the buffer has `capacity` poses, and the outputs are separate.
        let (status, message) = with_message(|error| unsafe {
            generate(self.instance, &raw const view, self.buffer.as_mut_ptr(), capacity, &raw mut written, error)
        });
        match status {
            abi::status::OK => {}
            abi::status::BAD_PARAMETER | abi::status::FAILED => return Err(self.failed(message)),
            abi::status::PANICKED => return Err(self.retire(format!("it panicked: {message}"))),
            unknown => return Err(self.retire(format!("it returned the unknown status {unknown}"))),
        }
        if written > capacity {
            return Err(self.retire(format!("it claims {written} candidates, there was room for {capacity}")));
        }
        for (candidate_idx, (candidate, view)) in out.iter_mut().zip(&self.buffer[..written]).enumerate() {
            let checked = views::candidate(view).map_err(|error| self.failed(format!("candidate {candidate_idx}: {error}")))?;
            *candidate = checked;
        }
        Ok(written)
    }
}

impl Drop for DynamicPoseGenerator {
    fn drop(&mut self) {
        // A retired instance leaks: its state is unknown, and running its destructor could do harm.
        if self.retired.is_none() {
            // SAFETY: obligation 1 of `PoseGeneratorTable::destroy`: it came from `create` and is not used after this.
            unsafe { (self.factory.table.destroy)(self.instance) };
        }
    }
}
