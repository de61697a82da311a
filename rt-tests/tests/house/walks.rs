//! The two walks that a newcomer makes first: each is a chain of functions, in which each one
//! calls the next.

use super::sources::{read, root};
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use std::collections::BTreeSet;
use syn::visit::{self, Visit};

/// A function of a walk: its file and its name.
type Step = (&'static str, &'static str);

/// From the device's sample to the force on the device.
pub const SAMPLE_TO_FORCE: [Step; 0] = [];

/// From the prediction of a contact to the face that was refined for it.
pub const PREDICTION_TO_FACE: [Step; 0] = [];

/// Checks that every function of a walk exists, that each of them names the next one, and that
/// the walk goes through at most `max_files` files.
pub fn assert_walk(what: &str, steps: &[Step], max_files: usize) {
    assert!(steps.len() > 4, "{what}: a walk has steps");
    let bodies: Vec<TokenStream> = steps.iter().map(|step| body_of(step)).collect();
    for ((step, body), next) in steps.iter().zip(&bodies).zip(&steps[1..]) {
        assert!(
            names(body.clone(), next.1),
            "{what}: {} {} does not call {}",
            step.0,
            step.1,
            next.1
        );
    }
    let files: BTreeSet<&str> = steps.iter().map(|step| step.0).collect();
    println!("{what}: {} functions in {} files", steps.len(), files.len());
    assert!(
        files.len() <= max_files,
        "{what}: {} files {files:?}",
        files.len()
    );
}

fn body_of(step: &Step) -> TokenStream {
    let mut found = Bodies {
        name: step.1,
        body: TokenStream::new(),
    };
    found.visit_file(&read(&root().join(step.0)).syntax);
    assert!(
        !found.body.is_empty(),
        "{} has no function {}",
        step.0,
        step.1
    );
    found.body
}

/// The bodies of all functions of a name.
struct Bodies {
    name: &'static str,
    body: TokenStream,
}

impl<'ast> Visit<'ast> for Bodies {
    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if item.sig.ident == self.name {
            self.body.extend(item.block.to_token_stream());
        }
        visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if item.sig.ident == self.name {
            self.body.extend(item.block.to_token_stream());
        }
        visit::visit_impl_item_fn(self, item);
    }
}

fn names(tokens: TokenStream, name: &str) -> bool {
    tokens.into_iter().any(|token| match token {
        TokenTree::Group(group) => names(group.stream(), name),
        TokenTree::Ident(ident) => ident == name,
        _ => false,
    })
}
