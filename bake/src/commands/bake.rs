//! Bakes: progress while it runs, then a summary as text or JSON.

use super::SUCCESS;
use crate::args::Args;
use crate::diagnostic::BakeError;
use crate::pipeline::{Options, bake};
use crate::progress::{Bar, Progress, Silent};
use crate::report::Summary;

pub(super) fn run(args: &Args) -> Result<u8, BakeError> {
    if let Some(threads) = args.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(usize::from(threads));
        // Fails only where a pool exists already, and nothing has run before.
        let _ = pool.build_global();
    }
    let summary = bake_with_progress(args)?;
    print(args, &summary);
    Ok(SUCCESS)
}

fn bake_with_progress(args: &Args) -> Result<Summary, BakeError> {
    let options = Options {
        environment: args.env.clone(),
        textures: args.textures(),
        light: args.light(),
        sky_format: args.sky_format(),
        limit_pixels: args.limit_pixels,
        ..Options::new(&args.input, &args.output)
    };
    if args.quiet || args.json {
        return bake(&options, &Silent);
    }
    let bar = Bar::new();
    let summary = bake(&options, &bar as &dyn Progress);
    bar.clear();
    summary
}

fn print(args: &Args, summary: &Summary) {
    if !args.quiet {
        for diagnostic in &summary.diagnostics {
            eprintln!("{diagnostic}");
        }
    }
    if args.json {
        match serde_json::to_string(summary) {
            Ok(json) => println!("{json}"),
            Err(error) => eprintln!("error[json]: {error}"),
        }
    } else if !args.quiet {
        print!("{}", summary.text(args.verbose));
    }
}
