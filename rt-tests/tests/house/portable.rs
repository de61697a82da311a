//! Functions that differ from machine to machine: those that the standard library and glam take
//! from the C library.

use super::sources::{Source, is_for_tests};
use syn::visit::{self, Visit};

/// Methods of floats, vectors and quaternions.
const METHODS: [&str; 34] = [
    "sin",
    "cos",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sin_cos",
    "sinh",
    "cosh",
    "tanh",
    "exp",
    "exp2",
    "exp_m1",
    "ln",
    "ln_1p",
    "log",
    "log2",
    "log10",
    "powf",
    "cbrt",
    "hypot",
    "slerp",
    "angle_between",
    "rotate_towards",
    "rotate_axis",
    "to_scaled_axis",
    "to_axis_angle",
    "to_euler",
    "from_scaled_axis",
    "from_axis_angle",
    "from_rotation_x",
    "from_rotation_y",
    "from_rotation_z",
];

/// Where the code of a file that is not for tests calls one of them.
pub fn calls_of_the_c_library(file: &Source) -> Vec<String> {
    let mut found = Calls {
        file: &file.shown,
        all: Vec::new(),
    };
    found.visit_file(&file.syntax);
    found.all
}

struct Calls<'a> {
    file: &'a str,
    all: Vec<String>,
}

impl Calls<'_> {
    fn look(&mut self, name: &syn::Ident) {
        if METHODS.iter().any(|method| name == method) {
            let line = name.span().start().line;
            self.all.push(format!("{}:{line} {name}", self.file));
        }
    }
}

impl<'ast> Visit<'ast> for Calls<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        self.look(&call.method);
        visit::visit_expr_method_call(self, call);
    }

    fn visit_expr_path(&mut self, path: &'ast syn::ExprPath) {
        // A function of a type, not one that a file brings in: those are `geometry::portable`.
        let segments = &path.path.segments;
        if segments.len() > 1
            && let Some(last) = segments.last()
            && segments[segments.len() - 2].ident != "portable"
        {
            self.look(&last.ident);
        }
        visit::visit_expr_path(self, path);
    }
}
