//! Bakes: progress while it runs, then a summary as text or JSON.

use super::{SUCCESS, print_json, print_text};
use crate::args::{Args, Settings};
use crate::cache::Place;
use crate::diagnostic::{BakeError, listing};
use crate::pipeline::{Options, bake};
use crate::progress::{Bar, Progress, Silent};
use crate::report::Summary;

pub(super) fn run(args: &Args, settings: &Settings) -> Result<u8, BakeError> {
    if let Some(threads) = settings.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
        // Fails only where a pool exists already, and nothing has run before.
        let _ = pool.build_global();
    }
    let summary = bake_with_progress(args, settings)?;
    print(args, &summary)?;
    Ok(SUCCESS)
}

fn bake_with_progress(args: &Args, settings: &Settings) -> Result<Summary, BakeError> {
    let cache = args.cache.clone().unwrap_or_else(Place::default_of_user);
    let options = Options {
        cache: cache.folder(),
        strict: args.strict.clone().unwrap_or_default(),
        ..settings.options(&args.input, &args.output)
    };
    if args.quiet || args.json {
        return bake(&options, &Silent);
    }
    let bar = Bar::new();
    let summary = bake(&options, &bar as &dyn Progress);
    bar.clear();
    summary
}

fn print(args: &Args, summary: &Summary) -> Result<(), BakeError> {
    if !args.quiet {
        eprint!("{}", listing(&summary.diagnostics));
    }
    if args.json {
        return print_json(summary);
    }
    if !args.quiet {
        print_text(&summary.text(args.verbose))?;
    }
    if args.explain {
        print_text(&explain(summary))?;
    }
    Ok(())
}

/// Every product with what became of it.
fn explain(summary: &Summary) -> String {
    let Some(cache) = &summary.cache else {
        return "the cache is off: everything was made anew\n".into();
    };
    let mut text = String::new();
    for product in &cache.products {
        let found = if product.hit { "hit " } else { "miss" };
        let kind = product.kind.name();
        text += &format!("{found} {kind:<16} {}: {}\n", product.name, product.why);
    }
    text += &match cache.unchanged {
        true => {
            "the output was left as it is: no input, setting or code changed, nor did the output\n"
                .into()
        }
        false => format!(
            "{} hits, {} misses in {}\n",
            cache.hits,
            cache.misses,
            cache.folder.display()
        ),
    };
    text
}
