//! `#[derive(Ports)]`.

use proc_macro2::{Span, TokenStream};
use quote::{quote, quote_spanned};
use syn::ext::IdentExt as _;
use syn::meta::ParseNestedMeta;
use syn::parse::ParseStream;
use syn::spanned::Spanned as _;
use syn::token::Bracket;
use syn::{
    Attribute, Data, DeriveInput, Error, Expr, Field, Fields, GenericArgument, Lit, LitFloat, LitStr, Meta, PathArguments,
    Result, Token, Type, UnOp, bracketed, parse2,
};

/// What a port is.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    Setting,
    Input,
    Output,
    InOut,
}

/// How a field holds the value of type `T`.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Copied,
    Shared,
    /// `In<T>`, `Out<T>` or `InOut<T>`.
    Handle,
}

/// What stands in `#[port(...)]`.
#[derive(Default)]
struct Settings {
    role: Option<Role>,
    optional: Option<Span>,
    default: Option<Expr>,
    min: Option<Expr>,
    max: Option<Expr>,
    key: Option<LitStr>,
    name: Option<LitStr>,
}

pub(crate) fn expand(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Struct(data) = &input.data else {
        return Err(Error::new_spanned(&input.ident, "ports are a struct with named fields"));
    };
    let fields: Vec<&Field> = match &data.fields {
        Fields::Named(fields) => fields.named.iter().collect(),
        Fields::Unit => Vec::new(),
        Fields::Unnamed(_) => return Err(Error::new_spanned(&input.ident, "ports are a struct with named fields")),
    };
    let (mut specs, mut reads, mut names) = (Vec::new(), Vec::new(), Vec::<String>::new());
    let mut mistakes: Option<Error> = None;
    for (port_idx, field) in fields.iter().enumerate() {
        match port(field, port_idx, &names) {
            Ok((name, spec, read)) => {
                specs.push(spec);
                reads.push(read);
                names.push(name);
            }
            // All mistakes at once.
            Err(error) => match &mut mistakes {
                Some(mistakes) => mistakes.combine(error),
                None => mistakes = Some(error),
            },
        }
    }
    if let Some(mistakes) = mistakes {
        return Err(mistakes);
    }
    let ident = &input.ident;
    let (impl_generics, type_generics, where_clause) = input.generics.split_for_impl();
    let body = if matches!(data.fields, Fields::Unit) { quote!(Self) } else { quote!(Self { #(#reads,)* }) };
    Ok(quote! {
        #[automatically_derived]
        impl #impl_generics ::sfg_tree::Ports for #ident #type_generics #where_clause {
            fn specs() -> ::std::vec::Vec<::sfg_tree::PortSpec> {
                ::std::vec![#(#specs,)*]
            }
            fn read<__Context>(
                __tick: &::sfg_tree::Tick<'_, __Context>,
            ) -> ::core::result::Result<Self, ::sfg_tree::Failure> {
                ::core::result::Result::Ok(#body)
            }
        }
    })
}

/// The name of a port, its declaration and the expression that reads it.
fn port(field: &Field, port_idx: usize, earlier: &[String]) -> Result<(String, TokenStream, TokenStream)> {
    let Some(ident) = &field.ident else { return Err(Error::new_spanned(field, "ports are a struct with named fields")) };
    let settings = Settings::of(field)?;
    let Some(role) = settings.role else {
        return Err(Error::new_spanned(
            ident,
            "a field needs #[port(setting)], #[port(input)], #[port(output)] or #[port(inout)]",
        ));
    };
    settings.check(role)?;
    let name = settings.name.as_ref().map_or_else(|| ident.unraw().to_string(), LitStr::value);
    if name.is_empty() || !name.chars().all(|letter| letter.is_alphanumeric() || letter == '_') {
        return Err(Error::new(
            settings.name.as_ref().map_or(ident.span(), LitStr::span),
            "a name has letters, digits and underscores",
        ));
    }
    if earlier.contains(&name) {
        return Err(Error::new(
            settings.name.as_ref().map_or(ident.span(), LitStr::span),
            format!("port {name:?} is declared twice"),
        ));
    }
    let (value_type, form) = settings.value_type(role, &field.ty)?;
    let span = value_type.span();
    let make = match role {
        Role::Setting => quote!(setting),
        Role::Input => quote!(input),
        Role::Output => quote!(output),
        Role::InOut => quote!(inout),
    };
    let mut spec = quote_spanned!(span=> ::sfg_tree::PortSpec::#make::<#value_type>(#name));
    if let Some(key) = &settings.key {
        spec.extend(quote!(.default_key(#key)));
    }
    if let Some(default) = &settings.default {
        spec.extend(quote_spanned!(default.span()=> .default_value(#default)));
    }
    if settings.min.is_some() || settings.max.is_some() {
        let min = settings.min.as_ref().map_or(quote!(::core::primitive::f64::NEG_INFINITY), float);
        let max = settings.max.as_ref().map_or(quote!(::core::primitive::f64::INFINITY), float);
        spec.extend(quote!(.range(#min, #max)));
    }
    if settings.optional.is_some() {
        spec.extend(quote!(.optional()));
    }
    let doc = doc_of(&field.attrs);
    if !doc.is_empty() {
        spec.extend(quote!(.doc(#doc)));
    }
    let read = match (form, settings.optional.is_some()) {
        (Form::Handle, _) => {
            let handle = match role {
                Role::Setting | Role::Input => quote!(In),
                Role::Output => quote!(Out),
                Role::InOut => quote!(InOut),
            };
            quote_spanned!(span=> ::sfg_tree::#handle::<#value_type>::at(#port_idx, #name))
        }
        (Form::Copied, false) => quote_spanned!(span=> __tick.get_at::<#value_type>(#port_idx, #name)?),
        (Form::Copied, true) => quote_spanned!(span=>
            __tick.optional_at::<#value_type>(#port_idx, #name)?.map(|value| <#value_type as ::core::clone::Clone>::clone(&value))
        ),
        (Form::Shared, false) => quote_spanned!(span=> ::sfg_tree::In::<#value_type>::at(#port_idx, #name).shared(__tick)?),
        (Form::Shared, true) => quote_spanned!(span=> __tick.optional_at::<#value_type>(#port_idx, #name)?),
    };
    Ok((name, spec, quote!(#ident: #read)))
}

impl Settings {
    fn of(field: &Field) -> Result<Self> {
        let mut settings = Self::default();
        for attribute in field.attrs.iter().filter(|attribute| attribute.path().is_ident("port")) {
            if matches!(attribute.meta, Meta::Path(_) | Meta::NameValue(_)) {
                return Err(Error::new_spanned(
                    attribute,
                    "write #[port(setting)], #[port(input)], #[port(output)] or #[port(inout)]",
                ));
            }
            attribute.parse_nested_meta(|meta| settings.word(&meta))?;
        }
        Ok(settings)
    }

    fn word(&mut self, meta: &ParseNestedMeta<'_>) -> Result<()> {
        let Some(word) = meta.path.get_ident().map(ToString::to_string) else { return Err(meta.error("expected a word")) };
        let role = match word.as_str() {
            "setting" => Some(Role::Setting),
            "input" => Some(Role::Input),
            "output" => Some(Role::Output),
            "inout" => Some(Role::InOut),
            _ => None,
        };
        if let Some(role) = role {
            return if self.role.replace(role).is_some() {
                Err(meta.error("a port is one of setting, input, output, inout"))
            } else {
                Ok(())
            };
        }
        let is_twice = match word.as_str() {
            "optional" => self.optional.replace(meta.path.span()).is_some(),
            "default" => self.default.replace(value_or_list(meta.value()?)?).is_some(),
            "min" => self.min.replace(meta.value()?.parse()?).is_some(),
            "max" => self.max.replace(meta.value()?.parse()?).is_some(),
            "key" => self.key.replace(meta.value()?.parse()?).is_some(),
            "name" => self.name.replace(meta.value()?.parse()?).is_some(),
            _ => {
                let known = "setting, input, output, inout, optional, default, min, max, key, name";
                return Err(meta.error(format!("unknown word {word:?}; known are {known}")));
            }
        };
        if is_twice { Err(meta.error(format!("{word:?} is given twice"))) } else { Ok(()) }
    }

    /// What does not go together.
    fn check(&self, role: Role) -> Result<()> {
        let is_setting = role == Role::Setting;
        for (word, value) in [("default", &self.default), ("min", &self.min), ("max", &self.max)] {
            if let Some(value) = value
                && !is_setting
            {
                return Err(Error::new_spanned(value, format!("only a setting has {word:?}: files give artefacts as keys")));
            }
        }
        if let (Some(default), Some(key)) = (&self.default, &self.key) {
            let mut error = Error::new_spanned(key, "a port has a default value or a default key, not both");
            error.combine(Error::new_spanned(default, "the default value is here"));
            return Err(error);
        }
        if let (Some(_), Some(optional)) = (&self.default, self.optional) {
            return Err(Error::new(optional, "a setting with a default always has a value; leave out `optional`"));
        }
        if let (Some(optional), Role::Output) = (self.optional, role) {
            return Err(Error::new(optional, "an output is never read; leave out `optional`"));
        }
        let number = |value: &Option<Expr>| value.as_ref().and_then(number_of);
        let (default, min, max) = (number(&self.default), number(&self.min), number(&self.max));
        if let (Some(min), Some(max)) = (min, max)
            && min > max
        {
            return Err(Error::new_spanned(&self.max, format!("max {max} is below min {min}")));
        }
        if let Some(default) = default
            && (min.is_some_and(|min| default < min) || max.is_some_and(|max| default > max))
        {
            return Err(Error::new_spanned(&self.default, format!("the default {default} is outside its limits")));
        }
        Ok(())
    }

    /// The type of the port's value and how the field holds it.
    fn value_type<'t>(&self, role: Role, field_type: &'t Type) -> Result<(&'t Type, Form)> {
        let fail = |message: &str| Err(Error::new_spanned(field_type, message));
        match role {
            Role::Output => {
                inner(field_type, "Out").map_or_else(|| fail("an output has the type `Out<T>`"), |t| Ok((t, Form::Handle)))
            }
            Role::InOut => inner(field_type, "InOut")
                .map_or_else(|| fail("an inout port has the type `InOut<T>`"), |t| Ok((t, Form::Handle))),
            Role::Setting | Role::Input => {
                if let Some(value_type) = inner(field_type, "In") {
                    return Ok((value_type, Form::Handle));
                }
                if inner(field_type, "Out").or(inner(field_type, "InOut")).is_some() {
                    return fail("this port is only read; use `T`, `Arc<T>` or `In<T>`, or make it an output or inout");
                }
                let held = match (inner(field_type, "Option"), self.optional) {
                    (Some(held), Some(_)) => held,
                    (None, None) => field_type,
                    (Some(_), None) => return fail("an `Option` needs `optional` in #[port(...)]"),
                    (None, Some(_)) => return fail("an optional port has the type `Option<T>`, `Option<Arc<T>>` or `In<T>`"),
                };
                Ok(inner(held, "Arc").map_or((held, Form::Copied), |value_type| (value_type, Form::Shared)))
            }
        }
    }
}

/// An expression; a list in brackets becomes a literal list, as an array has no type that ports take.
fn value_or_list(input: ParseStream<'_>) -> Result<Expr> {
    if !input.peek(Bracket) {
        return input.parse();
    }
    let content;
    bracketed!(content in input);
    let items = content.parse_terminated(value_or_list, Token![,])?.into_iter();
    parse2(quote!(::sfg_tree::Literal::List(::std::vec![#(::sfg_tree::Literal::from(#items)),*])))
}

/// `T` of `Wrapper<T>`, however the wrapper's path begins.
fn inner<'t>(wrapped: &'t Type, wrapper: &str) -> Option<&'t Type> {
    let Type::Path(path) = wrapped else { return None };
    let last = path.path.segments.last()?;
    let PathArguments::AngleBracketed(arguments) = &last.arguments else { return None };
    match arguments.args.first()? {
        GenericArgument::Type(inner) if last.ident == wrapper && arguments.args.len() == 1 => Some(inner),
        _ => None,
    }
}

/// A limit as a float, so that `min = 1` can be written.
fn float(limit: &Expr) -> TokenStream {
    match limit {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Int(number) => {
                let number = LitFloat::new(&format!("{}.0", number.base10_digits()), number.span());
                quote!(#number)
            }
            _ => quote!(#limit),
        },
        Expr::Unary(unary) if matches!(unary.op, UnOp::Neg(_)) => {
            let number = float(&unary.expr);
            quote!(-#number)
        }
        _ => quote!(#limit),
    }
}

/// The value of a number literal.
fn number_of(value: &Expr) -> Option<f64> {
    match value {
        Expr::Lit(literal) => match &literal.lit {
            Lit::Int(number) => number.base10_digits().parse().ok(),
            Lit::Float(number) => number.base10_digits().parse().ok(),
            _ => None,
        },
        Expr::Unary(unary) if matches!(unary.op, UnOp::Neg(_)) => number_of(&unary.expr).map(|number| -number),
        _ => None,
    }
}

/// The doc comment as one line.
fn doc_of(attributes: &[Attribute]) -> String {
    let line = |attribute: &Attribute| match &attribute.meta {
        Meta::NameValue(meta) if meta.path.is_ident("doc") => match &meta.value {
            Expr::Lit(literal) => match &literal.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    };
    attributes.iter().filter_map(line).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::expand;
    use syn::{DeriveInput, parse_str};

    #[track_caller]
    fn check(fields: &str, expected: &[&str]) {
        let input: DeriveInput = parse_str(&format!("struct P {{ {fields} }}")).expect("the test is a struct");
        let found: Vec<String> = match expand(&input) {
            Ok(_) => Vec::new(),
            Err(error) => error.into_iter().map(|error| error.to_string()).collect(),
        };
        assert_eq!(found, expected, "{fields}");
    }

    #[test]
    fn every_form_is_taken() {
        check(
            "#[port(setting)] a: f64, #[port(setting, optional)] b: Option<String>, #[port(setting, default = -1)] c: i32",
            &[],
        );
        check("#[port(input)] a: Arc<V>, #[port(input, optional)] b: Option<std::sync::Arc<V>>, #[port(input)] c: In<V>", &[]);
        check("#[port(output, key = \"k\")] a: Out<V>, #[port(inout, name = \"n\")] b: sfg_tree::InOut<u8>", &[]);
        check("#[port(setting, default = vec![1.0], min = 0, max = MOST)] a: Vec<f64>", &[]);
        check(
            "#[port(setting, default = [[1.0], []], optional)] a: V",
            &["a setting with a default always has a value; leave out `optional`"],
        );
        check("", &[]);
    }

    #[test]
    fn a_port_says_what_it_is() {
        let missing = "a field needs #[port(setting)], #[port(input)], #[port(output)] or #[port(inout)]";
        check("a: f64", &[missing]);
        check("#[port(optional)] a: Option<f64>", &[missing]);
        check("#[port] a: f64", &["write #[port(setting)], #[port(input)], #[port(output)] or #[port(inout)]"]);
        check("#[port(setting, input)] a: f64", &["a port is one of setting, input, output, inout"]);
        let known = "setting, input, output, inout, optional, default, min, max, key, name";
        check("#[port(setting, dflt = 1)] a: f64", &[&format!("unknown word \"dflt\"; known are {known}")]);
        check("a: f64, b: f64", &[missing, missing]);
    }

    #[test]
    fn words_go_with_what_the_port_is() {
        check("#[port(input, default = 1)] a: f64", &["only a setting has \"default\": files give artefacts as keys"]);
        check("#[port(output, max = 1)] a: Out<f64>", &["only a setting has \"max\": files give artefacts as keys"]);
        check(
            "#[port(setting, default = 1, optional)] a: Option<f64>",
            &["a setting with a default always has a value; leave out `optional`"],
        );
        check("#[port(output, optional)] a: Out<f64>", &["an output is never read; leave out `optional`"]);
        check(
            "#[port(setting, default = 1, key = \"k\")] a: f64",
            &["a port has a default value or a default key, not both", "the default value is here"],
        );
        check("#[port(setting, min = 1, min = 2)] a: f64", &["\"min\" is given twice"]);
    }

    #[test]
    fn types_go_with_what_the_port_is() {
        check("#[port(output)] a: f64", &["an output has the type `Out<T>`"]);
        check("#[port(inout)] a: Out<f64>", &["an inout port has the type `InOut<T>`"]);
        let only_read = "this port is only read; use `T`, `Arc<T>` or `In<T>`, or make it an output or inout";
        check("#[port(input)] a: Out<f64>", &[only_read]);
        check("#[port(input)] a: Option<f64>", &["an `Option` needs `optional` in #[port(...)]"]);
        let optional = "an optional port has the type `Option<T>`, `Option<Arc<T>>` or `In<T>`";
        check("#[port(input, optional)] a: Arc<f64>", &[optional]);
    }

    #[test]
    fn limits_and_names_are_looked_at() {
        check("#[port(setting, default = 2, min = 0.0, max = 1)] a: f64", &["the default 2 is outside its limits"]);
        check("#[port(setting, min = 1, max = -1)] a: f64", &["max -1 is below min 1"]);
        check("#[port(setting, name = \"b c\")] a: f64", &["a name has letters, digits and underscores"]);
        check("#[port(setting)] a: f64, #[port(input, name = \"a\")] b: f64", &["port \"a\" is declared twice"]);
    }

    #[test]
    fn only_structs_with_names_hold_ports() {
        for text in ["enum P { A }", "struct P(f64);"] {
            let error = expand(&parse_str(text).expect("an item")).expect_err("it is refused");
            assert_eq!(error.to_string(), "ports are a struct with named fields");
        }
    }
}
