//! The C boundary between the engine and a plugin in a dynamic library.
//!
//! Integers, floats, pointers and `repr(C)` structs of them, nothing else: no Rust enum, `bool`, `Vec` or trait object crosses,
//! so a library built by any compiler, C and C++ included, can be loaded. The crate depends on nothing.
//!
//! A library exports one symbol, a static [`Entry`] named [`ENTRY_SYMBOL`]. The host
//! 1. reads the first eight bytes ([`EntryHead`]; their meaning never changes) and refuses another [`ABI_MAJOR`],
//! 2. checks `struct_size`, calls [`Entry::init`],
//! 3. asks [`Entry::get_factory`] for tables by capability id (see [`capability`]); null means "not here".
//!
//! # Rules of every call
//! - **Evolution**: structs with a `struct_size` may grow at the end within a major version; a reader uses what the size covers.
//!   Elements of arrays never grow: a new layout is a new capability id, and the old table stays.
//! - **Lifetime, ownership**: inputs are lent until return. Outputs go to buffers of the caller, with a capacity. Each side frees
//!   what it allocated.
//! - **Thread**: one call at a time for each instance, on any thread. Different instances may be called at the same time.
//! - **Unwinding**: no panic and no exception leaves a call. A callee that catches one returns [`status::PANICKED`].
//! - **Retirement**: after [`status::PANICKED`] or a value that is no known status, the host never touches that instance again,
//!   not even to destroy it: its state is unknown.
//! - **Unloading**: a library stays mapped until the process ends.

#![no_std]

mod pose_generator;
mod text;

pub use pose_generator::{
    GraspTypeProfile, HandJoint, HandProfile, PalmPose, Pose, PoseGeneratorConfig, PoseGeneratorTable, PoseRequest, ScoreTerm,
    TERM_NAME_BYTES, TERMS_CAPACITY, TsdfView, grasp_type, hand_side,
};
pub use text::{ErrorBuffer, Text};

use core::ffi::c_void;

/// Host and library must agree on this number.
pub const ABI_MAJOR: u16 = 1;
/// Grows when a struct grows at its end. A library may be older or newer than the host.
pub const ABI_MINOR: u16 = 0;

/// Name of the one symbol a library exports, a static of type [`Entry`].
pub const ENTRY_SYMBOL: &str = "sfg_plugin_entry_v1";

/// Ids of the contracts, for [`Entry::get_factory`]. A new revision of a table is a new id.
pub mod capability {
    /// Infers how an object must be held. Its table is not defined yet.
    pub const LLM_BACKEND: &str = "sfg.llm-backend/1";
    /// Finds things and their parts. Its table is not defined yet.
    pub const GROUNDER: &str = "sfg.grounder/1";
    /// Proposes palm poses; the table is [`crate::PoseGeneratorTable`].
    pub const POSE_GENERATOR: &str = "sfg.pose-generator/1";
    /// Closes the hand. Its table is not defined yet.
    pub const GRASP_POLICY: &str = "sfg.grasp-policy/1";
    /// Moves a robot and reads its sensors. Its table is not defined yet.
    pub const DRIVER: &str = "sfg.driver/1";
}

/// The outcome of a call, one of [`status`]; an integer, because an unknown value must be survivable.
pub type RawStatus = i32;

/// The known values of a [`RawStatus`].
pub mod status {
    use super::RawStatus;

    /// The outputs hold.
    pub const OK: RawStatus = 0;
    /// A parameter is unknown or out of range; the message says which. The instance lives on.
    pub const BAD_PARAMETER: RawStatus = 1;
    /// The work failed; the message says why. The instance lives on.
    pub const FAILED: RawStatus = 2;
    /// A panic or exception was caught. The instance is retired.
    pub const PANICKED: RawStatus = 3;
}

/// The part of an [`Entry`] whose place and meaning never change, whatever the version.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EntryHead {
    /// Size of the whole [`Entry`] in the library, bytes.
    pub struct_size: u32,
    /// [`ABI_MAJOR`] of the library.
    pub abi_major: u16,
    /// [`ABI_MINOR`] of the library.
    pub abi_minor: u16,
}

/// What a library exports.
///
/// Function pointers are nullable so that a host can refuse a null one instead of calling it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Size and version.
    pub head: EntryHead,
    /// Prepares the library. Must be fast.
    ///
    /// Thread: any, not at the same time as `deinit`. State: any; calls nest, each successful one is paired with one `deinit`.
    /// Lifetime: `host` and `error` are lent until return. Unwinding: must not leave this call.
    ///
    /// # Safety
    /// 1. `host` points to a readable [`Host`], `error` to a writable [`ErrorBuffer`].
    pub init: Option<unsafe extern "C" fn(host: *const Host, error: *mut ErrorBuffer) -> RawStatus>,
    /// Gives back what `init` took.
    ///
    /// Thread: as `init`. State: after a successful `init`, when no instance of this library is left in use.
    ///
    /// # Safety
    /// 1. It closes one successful `init`.
    pub deinit: Option<unsafe extern "C" fn()>,
    /// The table of capability `id`, null when the library has none.
    ///
    /// Thread: any. State: after `init`. Lifetime: the table lives as long as the process. Ownership: the library's.
    ///
    /// # Safety
    /// 1. `id` is readable until return.
    pub get_factory: Option<unsafe extern "C" fn(id: Text) -> *const c_void>,
}

/// What a library learns about its host.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Host {
    /// Size of this struct in the host, bytes.
    pub struct_size: u32,
    /// [`ABI_MAJOR`] of the host.
    pub abi_major: u16,
    /// [`ABI_MINOR`] of the host.
    pub abi_minor: u16,
    /// Where the library was found, UTF-8.
    pub library_path: Text,
}

/// A plugin's own object; only the plugin knows what is in it.
#[repr(C)]
#[derive(Debug)]
pub struct Instance {
    _opaque: [u8; 0],
}

impl Entry {
    /// An entry of this ABI version.
    #[must_use]
    pub const fn new(
        init: unsafe extern "C" fn(*const Host, *mut ErrorBuffer) -> RawStatus,
        deinit: unsafe extern "C" fn(),
        get_factory: unsafe extern "C" fn(Text) -> *const c_void,
    ) -> Self {
        Self {
            head: EntryHead { struct_size: struct_size::<Self>(), abi_major: ABI_MAJOR, abi_minor: ABI_MINOR },
            init: Some(init),
            deinit: Some(deinit),
            get_factory: Some(get_factory),
        }
    }
}

/// The value of a `struct_size` field.
#[must_use]
pub const fn struct_size<T>() -> u32 {
    // Structs of this crate are far below 4 GiB.
    size_of::<T>() as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::mem::offset_of;

    /// A changed number here is a broken ABI: libraries that exist were built with these.
    #[test]
    #[cfg(target_pointer_width = "64")]
    fn layouts_are_frozen() {
        assert_eq!((size_of::<EntryHead>(), offset_of!(EntryHead, abi_major), offset_of!(EntryHead, abi_minor)), (8, 4, 6));
        assert_eq!((size_of::<Entry>(), offset_of!(Entry, init), offset_of!(Entry, get_factory)), (32, 8, 24));
        assert_eq!((size_of::<Text>(), size_of::<ErrorBuffer>(), size_of::<Host>()), (16, 24, 24));
        assert_eq!((size_of::<Pose>(), size_of::<ScoreTerm>(), size_of::<PalmPose>()), (56, 40, 728));
        assert_eq!((size_of::<TsdfView>(), offset_of!(TsdfView, distances), offset_of!(TsdfView, base_from_grid)), (96, 24, 40));
        assert_eq!((size_of::<HandJoint>(), size_of::<GraspTypeProfile>(), size_of::<HandProfile>()), (72, 40, 160));
        assert_eq!((size_of::<PoseRequest>(), offset_of!(PoseRequest, key_point_in_base)), (96, 40));
        assert_eq!((size_of::<PoseGeneratorConfig>(), offset_of!(PoseGeneratorConfig, hand)), (56, 48));
        assert_eq!((size_of::<PoseGeneratorTable>(), offset_of!(PoseGeneratorTable, generate)), (48, 40));
    }
}
