//! Length and nesting of functions.

use super::sources::{Source, is_for_tests};
use syn::spanned::Spanned;
use syn::visit::{self, Visit};

/// A function of the product.
#[derive(Debug)]
pub struct Function {
    /// File, line and name.
    pub place: String,
    /// From its signature to its closing brace.
    pub lines: usize,
    /// Control flow inside control flow, at its deepest.
    pub nesting: usize,
}

/// All functions of a file that are not for tests only.
pub fn of_file(file: &Source) -> Vec<Function> {
    let mut found = Functions {
        file: &file.shown,
        all: Vec::new(),
    };
    found.visit_file(&file.syntax);
    found.all
}

struct Functions<'a> {
    file: &'a str,
    all: Vec<Function>,
}

impl Functions<'_> {
    fn add(&mut self, signature: &syn::Signature, body: &syn::Block) {
        let (first, last) = (signature.span().start().line, body.span().end().line);
        let mut nesting = Nesting::default();
        nesting.visit_block(body);
        self.all.push(Function {
            place: format!("{}:{first} {}", self.file, signature.ident),
            lines: last + 1 - first,
            nesting: nesting.deepest,
        });
    }
}

impl<'ast> Visit<'ast> for Functions<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_for_tests(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_for_tests(&item.attrs) {
            self.add(&item.sig, &item.block);
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        if !is_for_tests(&item.attrs) {
            self.add(&item.sig, &item.block);
            visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_trait_item_fn(&mut self, item: &'ast syn::TraitItemFn) {
        if let Some(body) = &item.default {
            self.add(&item.sig, body);
        }
    }
}

#[derive(Debug, Default)]
struct Nesting {
    depth: usize,
    deepest: usize,
}

impl Nesting {
    fn deeper(&mut self, inside: impl FnOnce(&mut Self)) {
        self.depth += 1;
        self.deepest = self.deepest.max(self.depth);
        inside(self);
        self.depth -= 1;
    }
}

impl<'ast> Visit<'ast> for Nesting {
    /// A function inside of a function counts by itself.
    fn visit_item_fn(&mut self, _: &'ast syn::ItemFn) {}

    fn visit_expr_if(&mut self, expression: &'ast syn::ExprIf) {
        self.visit_expr(&expression.cond);
        self.deeper(|inner| inner.visit_block(&expression.then_branch));
        match expression.else_branch.as_ref().map(|(_, branch)| &**branch) {
            // `else if` goes on beside the `if`, not inside of it.
            Some(syn::Expr::If(next)) => self.visit_expr_if(next),
            Some(branch) => self.deeper(|inner| inner.visit_expr(branch)),
            None => {}
        }
    }

    fn visit_expr_match(&mut self, expression: &'ast syn::ExprMatch) {
        self.deeper(|inner| visit::visit_expr_match(inner, expression));
    }

    fn visit_expr_for_loop(&mut self, expression: &'ast syn::ExprForLoop) {
        self.deeper(|inner| visit::visit_expr_for_loop(inner, expression));
    }

    fn visit_expr_while(&mut self, expression: &'ast syn::ExprWhile) {
        self.deeper(|inner| visit::visit_expr_while(inner, expression));
    }

    fn visit_expr_loop(&mut self, expression: &'ast syn::ExprLoop) {
        self.deeper(|inner| visit::visit_expr_loop(inner, expression));
    }

    fn visit_expr_closure(&mut self, expression: &'ast syn::ExprClosure) {
        self.deeper(|inner| visit::visit_expr_closure(inner, expression));
    }
}
