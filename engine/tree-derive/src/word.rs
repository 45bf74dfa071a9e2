//! `#[derive(PortWord)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::ext::IdentExt as _;
use syn::{Data, DeriveInput, Error, Fields, LitStr, Result, Variant};

pub(crate) fn expand(input: &DeriveInput) -> Result<TokenStream> {
    let Data::Enum(data) = &input.data else { return Err(Error::new_spanned(&input.ident, "words are the variants of an enum")) };
    if data.variants.is_empty() {
        return Err(Error::new_spanned(&input.ident, "an enum of words has at least one variant"));
    }
    let mut words: Vec<String> = Vec::new();
    for variant in &data.variants {
        let word = word_of(variant)?;
        if words.contains(&word) {
            return Err(Error::new_spanned(&variant.ident, format!("the word {word:?} is given twice")));
        }
        words.push(word);
    }
    let ident = &input.ident;
    let variants: Vec<_> = data.variants.iter().map(|variant| &variant.ident).collect();
    let (impl_generics, type_generics, where_clause) = input.generics.split_for_impl();
    Ok(quote! {
        #[automatically_derived]
        impl #impl_generics ::sfg_tree::FromLiteral for #ident #type_generics #where_clause {
            fn shape() -> ::sfg_tree::Shape {
                ::sfg_tree::Shape::OneOf(::std::vec![#(::std::string::String::from(#words),)*])
            }
            fn from_literal(literal: &::sfg_tree::Literal) -> ::core::result::Result<Self, ::std::string::String> {
                if let ::sfg_tree::Literal::Text(word) = literal {
                    match word.as_str() {
                        #(#words => return ::core::result::Result::Ok(Self::#variants),)*
                        _ => {}
                    }
                }
                ::core::result::Result::Err(::std::format!(
                    "expected {}, found {literal}",
                    <Self as ::sfg_tree::FromLiteral>::shape()
                ))
            }
            fn to_literal(&self) -> ::core::option::Option<::sfg_tree::Literal> {
                let word = match self { #(Self::#variants => #words,)* };
                ::core::option::Option::Some(::sfg_tree::Literal::from(word))
            }
        }
        #[automatically_derived]
        impl #impl_generics ::core::convert::From<#ident #type_generics> for ::sfg_tree::Literal #where_clause {
            fn from(value: #ident #type_generics) -> Self {
                let word = match value { #(#ident::#variants => #words,)* };
                ::sfg_tree::Literal::from(word)
            }
        }
    })
}

/// `TopDown` -> `top_down`, or what `#[word("...")]` says.
fn word_of(variant: &Variant) -> Result<String> {
    if !matches!(variant.fields, Fields::Unit) {
        return Err(Error::new_spanned(variant, "a word holds nothing; use a variant without fields"));
    }
    if let Some(attribute) = variant.attrs.iter().find(|attribute| attribute.path().is_ident("word")) {
        let word: LitStr = attribute.parse_args()?;
        return if word.value().is_empty() { Err(Error::new_spanned(&word, "a word has letters")) } else { Ok(word.value()) };
    }
    let mut word = String::new();
    for letter in variant.ident.unraw().to_string().chars() {
        if letter.is_uppercase() && !word.is_empty() {
            word.push('_');
        }
        word.extend(letter.to_lowercase());
    }
    Ok(word)
}

#[cfg(test)]
mod tests {
    use super::{expand, word_of};
    use syn::{DeriveInput, parse_str};

    #[test]
    fn variants_become_words() {
        let word = |text: &str| word_of(&parse_str(text).expect("a variant")).map_err(|error| error.to_string());
        assert_eq!(word("Left"), Ok("left".to_owned()));
        assert_eq!(word("TopDown"), Ok("top_down".to_owned()));
        assert_eq!(word("#[word(\"2d\")] Flat"), Ok("2d".to_owned()));
        assert_eq!(word("Angle(f64)"), Err("a word holds nothing; use a variant without fields".to_owned()));
    }

    #[test]
    fn only_enums_of_different_words_are_taken() {
        let check = |text: &str, expected: &str| {
            let input: DeriveInput = parse_str(text).expect("an item");
            assert_eq!(expand(&input).expect_err("it is refused").to_string(), expected);
        };
        check("struct Side;", "words are the variants of an enum");
        check("enum Side {}", "an enum of words has at least one variant");
        check("enum Side { Left, #[word(\"left\")] Right }", "the word \"left\" is given twice");
    }
}
