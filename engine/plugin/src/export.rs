//! The dynamic form of a Rust type: every call guarded against panics, every value converted and checked.

#![expect(unsafe_code, reason = "the plugin's side of the C boundary")]

use crate::views::{self, OwnedPoseRequest};
use crate::{PluginContext, PluginError, PoseGenerator};
use sfg_plugin_abi as abi;
use sfg_types::PalmPoseCandidate;
use std::any::Any;
use std::ffi::c_void;
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// A pose generator that can be exported from a library.
pub trait ExportPoseGenerator: PoseGenerator + Sized + 'static {
    /// The name a scenario asks for: lower-case letters, digits, `-` and `_`.
    const NAME: &'static str;

    /// Makes one.
    ///
    /// # Errors
    /// [`PluginError::BadParameter`] when a parameter is unknown or out of range.
    fn make(context: &PluginContext<'_>) -> Result<Self, PluginError>;
}

/// Exports a type that implements [`ExportPoseGenerator`](crate::export::ExportPoseGenerator) from a crate of type `cdylib`.
///
/// Use it once, in the `cdylib` only: it defines the symbol `sfg_plugin_entry_v1`, and a program that links two such crates
/// statically has that symbol twice. Built-in plugins register their type with the host instead.
///
/// ```
/// use sfg_plugin::{PluginContext, PluginError, PoseGenerator, PoseRequest, export::ExportPoseGenerator};
/// use sfg_types::PalmPoseCandidate;
///
/// struct Nothing;
///
/// impl PoseGenerator for Nothing {
///     fn generate(&mut self, _: &PoseRequest<'_>, _: &mut [PalmPoseCandidate]) -> Result<usize, PluginError> {
///         Ok(0)
///     }
/// }
///
/// impl ExportPoseGenerator for Nothing {
///     const NAME: &'static str = "nothing";
///     fn make(_: &PluginContext<'_>) -> Result<Self, PluginError> {
///         Ok(Self)
///     }
/// }
///
/// sfg_plugin::export_pose_generator!(Nothing);
/// # fn main() {}
/// ```
#[macro_export]
macro_rules! export_pose_generator {
    ($generator:ty) => {
        /// What the host reads first.
        #[allow(unsafe_code, non_upper_case_globals, reason = "the name of the symbol is fixed by the C boundary")]
        #[unsafe(no_mangle)]
        pub static sfg_plugin_entry_v1: $crate::abi::Entry = $crate::export::entry::<$generator>();
    };
}

/// The entry of a library that holds the generator `T` and nothing else.
#[must_use]
pub const fn entry<T: ExportPoseGenerator>() -> abi::Entry {
    abi::Entry::new(init, deinit, get_factory::<T>)
}

/// The functions of `T` as C sees them.
#[derive(Debug)]
pub struct Exported<T>(PhantomData<T>);

impl<T: ExportPoseGenerator> Exported<T> {
    /// The table of [`abi::capability::POSE_GENERATOR`].
    pub const TABLE: &'static abi::PoseGeneratorTable = &abi::PoseGeneratorTable {
        struct_size: abi::struct_size::<abi::PoseGeneratorTable>(),
        reserved: 0,
        name: abi::Text::new(T::NAME),
        create: Some(create::<T>),
        destroy: Some(destroy::<T>),
        generate: Some(generate::<T>),
    };
}

/// What an instance is on this side.
struct Exporter<T> {
    generator: T,
    /// Kept between calls, so that a call allocates nothing but the copies of the request.
    candidates: Vec<PalmPoseCandidate>,
}

unsafe extern "C" fn init(_host: *const abi::Host, _error: *mut abi::ErrorBuffer) -> abi::RawStatus {
    abi::status::OK
}

unsafe extern "C" fn deinit() {}

unsafe extern "C" fn get_factory<T: ExportPoseGenerator>(id: abi::Text) -> *const c_void {
    // SAFETY: the id is readable until return (obligation 1 of `Entry::get_factory`).
    match unsafe { id.as_str() } {
        Some(abi::capability::POSE_GENERATOR) => std::ptr::from_ref(Exported::<T>::TABLE).cast(),
        _ => std::ptr::null(),
    }
}

unsafe extern "C" fn create<T: ExportPoseGenerator>(
    config: *const abi::PoseGeneratorConfig,
    instance: *mut *mut abi::Instance,
    error: *mut abi::ErrorBuffer,
) -> abi::RawStatus {
    let make = || {
        // SAFETY: obligation 1 of `PoseGeneratorTable::create`: config, texts and hand are readable until return.
        let (config, params, scenarios_dir, hand) = unsafe {
            let config = views::read_sized(config, "the configuration")?;
            let params = views::text(config.params_json, "the parameters")?;
            (config, params, views::text(config.scenarios_dir, "the scenario folder")?, views::hand_profile(config.hand)?)
        };
        let params = serde_json::from_str(&params).map_err(|error| PluginError::BadParameter {
            plugin: T::NAME.to_owned(),
            message: format!("the parameters are no JSON: {error}"),
        })?;
        let generator = T::make(&PluginContext {
            params: &params,
            scenarios_dir: Path::new(&scenarios_dir),
            hand: &hand,
            hand_side: views::hand_side(config.hand_side)?,
            seed: config.seed,
        })?;
        let boxed = Box::new(Exporter { generator, candidates: Vec::new() });
        // SAFETY: obligation 2: `instance` is writable. The box is freed in `destroy`.
        unsafe { instance.write(Box::into_raw(boxed).cast()) };
        Ok(())
    };
    // SAFETY: obligation 2: `error` is writable.
    unsafe { guarded(error, make) }
}

unsafe extern "C" fn destroy<T: ExportPoseGenerator>(instance: *mut abi::Instance) {
    // SAFETY: obligation 1 of `PoseGeneratorTable::destroy`: it came from `create`, which made a box of this type, and is not used again.
    let boxed = unsafe { Box::from_raw(instance.cast::<Exporter<T>>()) };
    // There is no status to report a panicking destructor with; its message was printed by the panic hook.
    if let Err(payload) = catch_unwind(AssertUnwindSafe(|| drop(boxed))) {
        std::mem::forget(payload);
    }
}

unsafe extern "C" fn generate<T: ExportPoseGenerator>(
    instance: *mut abi::Instance,
    request: *const abi::PoseRequest,
    out: *mut abi::PalmPose,
    capacity: usize,
    written: *mut usize,
    error: *mut abi::ErrorBuffer,
) -> abi::RawStatus {
    let run = || {
        // SAFETY: obligation 1 of `PoseGeneratorTable::generate`, and calls on one instance do not overlap.
        let exporter = unsafe { &mut *instance.cast::<Exporter<T>>() };
        // SAFETY: obligation 2.
        let request = unsafe { OwnedPoseRequest::read(request) }?;
        let unset = views::candidate(&abi::PalmPose::UNSET)?;
        exporter.candidates.clear();
        exporter.candidates.resize(capacity, unset);
        let n = exporter.generator.generate(&request.as_request(), &mut exporter.candidates)?;
        assert!(n <= capacity, "the generator claims {n} candidates, {capacity} were asked for");
        for (i, candidate) in exporter.candidates[..n].iter().enumerate() {
            // SAFETY: obligation 3: `i < capacity`.
            unsafe { out.add(i).write(views::palm_pose_view(candidate)?) };
        }
        // SAFETY: obligation 4.
        unsafe { written.write(n) };
        Ok(())
    };
    // SAFETY: obligation 4.
    unsafe { guarded(error, run) }
}

/// Why a guarded call failed.
enum CallError {
    Plugin(PluginError),
    View(views::ViewError),
}

impl From<PluginError> for CallError {
    fn from(error: PluginError) -> Self {
        Self::Plugin(error)
    }
}

impl From<views::ViewError> for CallError {
    fn from(error: views::ViewError) -> Self {
        Self::View(error)
    }
}

/// Runs `call`; errors and panics become a status and a message.
///
/// # Safety
/// 1. `error` is writable and its buffer has the stated capacity.
unsafe fn guarded(error: *mut abi::ErrorBuffer, call: impl FnOnce() -> Result<(), CallError>) -> abi::RawStatus {
    // Nothing of an instance is used after a panic: the host retires it.
    let (status, message) = match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => return abi::status::OK,
        Ok(Err(CallError::Plugin(PluginError::BadParameter { message, .. }))) => (abi::status::BAD_PARAMETER, message),
        Ok(Err(CallError::Plugin(PluginError::Failed { message, .. }))) => (abi::status::FAILED, message),
        Ok(Err(CallError::View(error))) => (abi::status::FAILED, error.to_string()),
        Err(payload) => (abi::status::PANICKED, panic_message(payload)),
    };
    // SAFETY: obligation 1.
    unsafe { (*error).write(&message) };
    status
}

fn panic_message(payload: Box<dyn Any + Send>) -> String {
    let message = match (payload.downcast_ref::<&str>(), payload.downcast_ref::<String>()) {
        (Some(text), _) => (*text).to_owned(),
        (_, Some(text)) => text.clone(),
        _ => "a panic without a text".to_owned(),
    };
    // Its destructor is the plugin's code and could panic again.
    std::mem::forget(payload);
    message
}
