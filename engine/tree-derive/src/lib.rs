//! Derive macros of `sfg-tree`. Use them through that crate, which says what the results mean.

mod ports;
mod word;

use proc_macro::TokenStream;
use proc_macro2::TokenStream as Tokens;
use syn::DeriveInput;

/// The ports of a node as a struct: implements `sfg_tree::Ports`.
///
/// Every field has one `#[port(...)]` that begins with what the port is; its doc comment is the port's description.
///
/// | first word | field type | also |
/// |---|---|---|
/// | `setting` | `T`, copied; `Arc<T>`, shared; `In<T>`, read when asked | `default = value`, or `optional` with `Option` around the type; `min`, `max` |
/// | `input` | the same | `optional` with `Option` around the type |
/// | `output` | `Out<T>` | - |
/// | `inout` | `InOut<T>` | `optional` |
///
/// Everywhere: `name = "..."`, the port's name in files, else the field's; `key = "..."`, the blackboard key used when the
/// file says nothing. Mistakes are compile errors at the field.
#[proc_macro_derive(Ports, attributes(port))]
pub fn derive_ports(input: TokenStream) -> TokenStream {
    expand(input, ports::expand)
}

/// An enum given in files as one of a few words: implements `sfg_tree::FromLiteral` and `From<Self> for sfg_tree::Literal`.
///
/// `TopDown` is written `top_down`; `#[word("...")]` at a variant says otherwise.
#[proc_macro_derive(PortWord, attributes(word))]
pub fn derive_port_word(input: TokenStream) -> TokenStream {
    expand(input, word::expand)
}

fn expand(input: TokenStream, macro_of: fn(&DeriveInput) -> syn::Result<Tokens>) -> TokenStream {
    let tokens = syn::parse(input).and_then(|input| macro_of(&input));
    tokens.unwrap_or_else(|error| error.to_compile_error()).into()
}
