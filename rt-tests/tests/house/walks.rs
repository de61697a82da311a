//! The two walks that a newcomer makes first. A walk is a list of stretches: in each of them every
//! function calls the next one; a stretch begins where an earlier one has been.

use super::sources::{read, root};
use proc_macro2::{TokenStream, TokenTree};
use quote::ToTokens;
use std::collections::BTreeSet;
use syn::visit::{self, Visit};

/// A function of a walk: its file and its name.
type Step = (&'static str, &'static str);

/// From the device's sample to the force on the device.
pub const SAMPLE_TO_FORCE: [&[Step]; 5] = [
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "sample"),
        ("hrtc/core/src/probe/mod.rs", "sample"),
    ],
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "contact"),
        ("hrtc/core/src/active/object.rs", "find_contact"),
        ("hrtc/core/src/probe/contacts.rs", "advance"),
        ("hrtc/core/src/probe/pair.rs", "advance"),
        ("hrtc/core/src/probe/proxy_kind.rs", "advance"),
        ("hrtc/core/src/contact/sphere_proxy/mod.rs", "advance"),
        ("hrtc/core/src/contact/sphere_proxy/mod.rs", "take_steps"),
        ("hrtc/core/src/contact/sphere_proxy/mod.rs", "collect_near"),
        ("hrtc/core/src/contact/query/near_faces.rs", "collect"),
    ],
    &[
        ("hrtc/core/src/probe/contacts.rs", "advance"),
        ("hrtc/core/src/probe/pair.rs", "render"),
        ("hrtc/core/src/force/effects/mod.rs", "render_contact"),
    ],
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "limit"),
        ("hrtc/core/src/probe/mod.rs", "limit"),
        ("hrtc/core/src/force/passivity.rs", "share"),
    ],
    &[
        ("hrtc/core/src/probe/mod.rs", "limit"),
        ("hrtc/core/src/force/limiter.rs", "pass"),
    ],
];

/// From the prediction of a contact to the face that was refined for it.
pub const PREDICTION_TO_FACE: [&[Step]; 4] = [
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "predict"),
        ("hrtc/core/src/active/object.rs", "predict"),
        ("hrtc/core/src/lod/prediction.rs", "predict"),
        ("hrtc/core/src/lod/prediction.rs", "predict_rings"),
        ("hrtc/core/src/lod/predict.rs", "predict"),
    ],
    &[
        ("hrtc/core/src/active/object.rs", "predict"),
        ("hrtc/core/src/streaming/session.rs", "request"),
        ("hrtc/core/src/streaming/subscriber.rs", "requests"),
    ],
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "receive"),
        ("hrtc/core/src/active/active_set.rs", "receive"),
        ("hrtc/core/src/active/active_set.rs", "take_chunks"),
        ("hrtc/core/src/active/object.rs", "receive"),
        ("hrtc/core/src/streaming/session.rs", "receive"),
        ("hrtc/core/src/streaming/session.rs", "take"),
        ("hrtc/core/src/streaming/answers.rs", "take_answers"),
        ("hrtc/core/src/streaming/answers.rs", "take_item"),
        ("hrtc/core/src/streaming/answers.rs", "take_record"),
        ("hrtc/core/src/cache/mod.rs", "load"),
    ],
    &[
        ("hrtc/core/src/tick.rs", "tick"),
        ("hrtc/core/src/tick.rs", "refine"),
        ("hrtc/core/src/active/object.rs", "refine"),
        ("hrtc/core/src/lod/refine.rs", "refine"),
        ("hrtc/core/src/lod/refine.rs", "split_wanted"),
        ("hrtc/core/src/lod/refine.rs", "try_split"),
        ("hrtc/core/src/lod/refine.rs", "split"),
        ("hrtc/core/src/cache/operations.rs", "split"),
        ("shared/spm/src/active_mesh.rs", "split"),
    ],
];

/// Checks that every function of a walk exists, that each of a stretch names the next one, that
/// the stretches hang together, and that the walk goes through at most `max_files` files.
pub fn assert_walk(what: &str, stretches: &[&[Step]], max_files: usize) {
    let mut seen: BTreeSet<Step> = BTreeSet::new();
    for stretch in stretches {
        let begins_on_the_walk = seen.is_empty() || seen.contains(&stretch[0]);
        assert!(
            begins_on_the_walk,
            "{what}: nothing leads to {:?}",
            stretch[0]
        );
        for pair in stretch.windows(2) {
            let (from, to) = (&pair[0], &pair[1]);
            let calls = names(body_of(from), to.1);
            assert!(
                calls,
                "{what}: {} {} does not call {}",
                from.0, from.1, to.1
            );
        }
        body_of(&stretch[stretch.len() - 1]);
        seen.extend(stretch.iter().copied());
    }
    let files: BTreeSet<&str> = seen.iter().map(|step| step.0).collect();
    println!("{what}: {} functions in {} files", seen.len(), files.len());
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
