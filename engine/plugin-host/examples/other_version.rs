//! A plugin from the future: of its entry, only the head may be read.

#![expect(unsafe_code, reason = "it exports a symbol")]

use sfg_plugin::abi::{ABI_MAJOR, EntryHead};

/// Shorter than an entry of this version, so that a host that reads on is found out.
#[unsafe(no_mangle)]
pub static sfg_plugin_entry_v1: EntryHead = EntryHead { struct_size: 8, abi_major: ABI_MAJOR + 1, abi_minor: 0 };
