//! `include_model!`: a coefficient file becomes a module of evaluators at compile time.
//!
//! In: the path of a model file, relative to the folder of the package's `Cargo.toml`, and a precision. Out: `pub mod <model> { ... }` with the same
//! text as `rsm emit --lang rust` and build.rs, because all three call one function of `rsm-core`. A fault in the file is a compile error under the
//! path; its text has the file's line and column. The macro contains no arithmetic on coefficients: it parses its arguments, calls the compiler and
//! places the error.
//!
//! ```text
//! include_model!("models/pmac.toml");                       // every precision that can hold the model
//! include_model!("models/pmac.toml", precision = "f32");    // or "f64", or "both": an error if it cannot hold the model
//! include_model!("models/pmac.toml", gradient = true);      // also the derivatives of each surface by its inputs
//! include_model!("models/pmac.toml", inside = true);        // also each surface without clamps, for a caller that keeps to the ranges
//! include_model!("models/pmac.toml", once = "current");     // also without clamps, and what the current gives to it apart
//! include_model!("models/pmac.toml", recursive = "current_advance", noise = 0.5);   // also the step by which it follows measured responses
//!
//! let angle = pmac::current_advance_f32(10.8, 400.0);
//! ```

mod arguments;

use std::path::{Path, PathBuf};

use proc_macro::TokenStream;
use rsm_core::compile::{self, RustModule};
use rsm_core::source::{Fault, Faults, Source};

use arguments::Arguments;

/// Includes a model file as a module of its name. See the documentation of the crate.
#[proc_macro]
pub fn include_model(tokens: TokenStream) -> TokenStream {
    let arguments = syn::parse_macro_input!(tokens as Arguments);
    expand(&arguments).unwrap_or_else(|error| error.into_compile_error().into())
}

fn expand(arguments: &Arguments) -> syn::Result<TokenStream> {
    let refuse = |what: String| syn::Error::new(arguments.path.span(), what);
    let named = arguments.path.value();
    let Some(package) = std::env::var_os("CARGO_MANIFEST_DIR") else {
        return Err(refuse("CARGO_MANIFEST_DIR is not set: the path is relative to it, so build with cargo".to_string()));
    };
    let path: PathBuf = Path::new(&package).join(&named);
    let source = Source::read(&path).and_then(|source| {
        // Messages name the file by the text of the literal.
        compile::rust_with_parts(&Source::new(named.clone(), source.text()), &arguments.precisions, &arguments.parts)
    });
    let RustModule { model, text } = source.map_err(|faults| refuse(message(&named, &faults)))?;

    let module: proc_macro2::TokenStream =
        text.parse().map_err(|error| refuse(format!("internal error: the emitted text is not Rust: {error}")))?;
    let model = syn::Ident::new(&model, arguments.path.span());
    let title = format!("Evaluators of the model file `{named}`.");
    let watched = path.to_str().ok_or_else(|| refuse(format!("the path {} is not UTF-8", path.display())))?;
    Ok(quote::quote! {
        #[doc = #title]
        pub mod #model {
            #module
            // The compiler records that this crate depends on the file, so an edited file is compiled again.
            const _: &[u8] = include_bytes!(#watched);
        }
    }
    .into())
}

/// All faults, in the order of the file.
fn message(named: &str, faults: &Faults) -> String {
    let lines = faults.list().iter().map(|fault| {
        // A fault of a file that cannot be read has the full path; replace it by the literal.
        Fault { file: named.to_string(), ..fault.clone() }.to_string()
    });
    lines.collect::<Vec<_>>().join("\n")
}
