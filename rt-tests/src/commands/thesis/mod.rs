//! `rt-tests thesis`: the figures of the thesis's performance studies, measured on its models, with
//! the published numbers beside ours.
//!
//! | module | holds |
//! |---|---|
//! | `models` | the models of Table 4.1, and the table |
//! | `updates` | Figure 4.7 and the costs of 3.3.3 |
//! | `queries` | Figure 5.20, and static levels of detail against the CDPM (4.3.2) |
//! | `lod_steps` | Figure 4.2 |
//! | `frames` | Figure 4.8 |
//! | `two_fronts` | what Figure 5.16 draws |
//! | `refinement` | Figure 5.19 |
//! | `server` | the station's load of a subscription (5.8) |
//! | `pairs` | two objects that touch, and the time of their query |
//! | `result`, `page` | the JSON; the terminal and the page |

mod frames;
mod lod_steps;
mod models;
mod page;
mod pairs;
mod queries;
mod refinement;
mod result;
mod server;
mod two_fronts;
mod updates;

pub use result::{Figure, Quote, Series, Thesis};

use crate::failure::Failure;
use crate::machine::Machine;
use crate::report::chart::Stroke;
use crate::report::output::{make_folder, print_either, status_line, write_json, write_whole};
use clap::Args;
use indicatif::ProgressBar;
use models::StudyModel;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use std::path::PathBuf;

/// Arguments of `rt-tests thesis`.
#[derive(Debug, Args)]
pub struct ThesisArgs {
    /// Mesh files, or folders with them: sphere, cow, bunny and dragon are found by their names
    /// [default: a generated sphere alone]
    #[arg(value_name = "PATH")]
    pub paths: Vec<PathBuf>,
    /// Only this one: table4.1, 4.2, 4.7, 4.8, 5.16, 5.19, 5.20, or a section: 3.3.3, 4.3.2, 5.8
    #[arg(long, value_name = "NUMBER")]
    pub figure: Option<String>,
    /// Folder of the page and the JSON
    #[arg(long, value_name = "DIR", default_value = "reports/thesis")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Seed of the paths and tours
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
}

/// How a figure is measured.
type Measure = fn(&Study) -> Result<Figure, Failure>;

/// All, in the order of the thesis.
const FIGURES: [(&str, Measure); 10] = [
    ("3.3.3", updates::costs),
    ("4.2", lod_steps::figure_4_2),
    ("table4.1", |study| Ok(models::table(&study.models))),
    ("4.7", updates::figure_4_7),
    ("4.3.2", queries::static_against_cdpm),
    ("4.8", frames::figure_4_8),
    ("5.16", two_fronts::figure_5_16),
    ("5.8", server::load),
    ("5.19", refinement::figure_5_19),
    ("5.20", queries::figure_5_20),
];
/// Those that are figures; the others are sections or a table.
const IS_FIGURE: [&str; 6] = ["4.2", "4.7", "4.8", "5.16", "5.19", "5.20"];

/// The models, and where the measurements stand.
pub struct Study {
    models: Vec<StudyModel>,
    seed: u64,
    line: ProgressBar,
    figure: &'static str,
}

impl Study {
    /// Random numbers, the same for every figure and model.
    fn random(&self) -> Xoshiro256PlusPlus {
        Xoshiro256PlusPlus::seed_from_u64(self.seed)
    }

    /// Tells what is measured.
    fn says(&self, of: &StudyModel, what: &str) {
        let message = format!("{}: {}: {what}", self.figure, of.name);
        self.line.set_message(message);
    }

    /// The models with their colours.
    fn names(&self) -> Vec<(String, &'static str, Stroke)> {
        let models = self.models.iter();
        models
            .map(|of| (of.name.clone(), of.color, Stroke::Solid))
            .collect()
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input, 1 when something cannot be measured; the figures that can
/// are there all the same.
pub fn thesis(args: &ThesisArgs) -> Result<(), Failure> {
    let chosen = chosen(args.figure.as_deref())?;
    make_folder(&args.out)?;
    eprintln!("opening and building the models");
    let mut study = Study {
        models: models::open_all(&args.paths)?,
        seed: args.seed,
        line: status_line(),
        figure: "",
    };
    if study.models.is_empty() {
        return Err(Failure::Input("no mesh file is given".to_string()));
    }
    let (figures, failed) = measure_all(&mut study, &chosen)?;
    study.line.finish_and_clear();
    let found = Thesis {
        seed: args.seed,
        models: study.models.iter().map(|of| of.name.clone()).collect(),
        figures,
        failed,
    };
    let page = args.out.join("thesis.html");
    write_whole(&page, page::page(&found, &Machine::read()).as_bytes())?;
    write_json(&args.out.join("thesis.json"), &found)?;
    let words = format!("{}\npage: {}\n", page::words(&found), page.display());
    print_either(args.json, &words, &found)?;
    if found.failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(found.failed.join("; ")))
}

/// Measures figures: those that came, and of the others why not, a sentence each. One that fails
/// says nothing of the others.
///
/// # Errors
/// The failure where none came: it is all that there is to say.
fn measure_all(
    study: &mut Study,
    chosen: &[(&'static str, Measure)],
) -> Result<(Vec<Figure>, Vec<String>), Failure> {
    let (mut figures, mut failures) = (Vec::new(), Vec::new());
    for &(number, measure) in chosen {
        study.figure = number;
        match measure(study).and_then(finite) {
            Ok(figure) => figures.push(figure),
            Err(failure) => failures.push((number, failure)),
        }
    }
    if figures.is_empty()
        && let Some((_, first)) = failures.first()
    {
        return Err(first.clone());
    }
    let failed = failures.into_iter();
    let failed = failed.map(|(number, failure)| format!("{number}: {failure}"));
    Ok((figures, failed.collect()))
}

/// The figures that were asked for.
fn chosen(figure: Option<&str>) -> Result<Vec<(&'static str, Measure)>, Failure> {
    let Some(asked) = figure else {
        return Ok(FIGURES.to_vec());
    };
    let found = FIGURES.iter().find(|(number, _)| *number == asked);
    found.map(|&figure| vec![figure]).ok_or_else(|| {
        let numbers = FIGURES.map(|(number, _)| number).join(", ");
        Failure::Input(format!(
            "--figure {asked} is not measured; choose one of {numbers}"
        ))
    })
}

/// A number that is none is a failure and not a result.
fn finite(figure: Figure) -> Result<Figure, Failure> {
    let mut series = figure.series.iter();
    match series.find(|series| !series.ours.is_finite()) {
        None => Ok(figure),
        Some(series) => Err(Failure::Run(format!("{} is no number", series.name))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A figure of one number.
    fn figure(ours: f64) -> Figure {
        Figure {
            figure: "4.7",
            title: "made up",
            series: vec![Series::new("ours", "", ours)],
            says: "Nothing.".to_string(),
            quotes: Vec::new(),
            charts: Vec::new(),
            names: Vec::new(),
        }
    }

    #[test]
    fn a_figure_that_fails_leaves_the_others() {
        let mut study = Study {
            models: Vec::new(),
            seed: 1,
            line: ProgressBar::hidden(),
            figure: "",
        };
        let good: (&str, Measure) = ("4.7", |_| Ok(figure(1.0)));
        let refused: (&str, Measure) = ("4.8", |_| Err(Failure::Input("no region".to_string())));
        let no_number: (&str, Measure) = ("5.8", |_| Ok(figure(f64::NAN)));
        let found = measure_all(&mut study, &[refused, good, no_number]);
        let (figures, failed) = found.unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(figures.len(), 1);
        assert_eq!(failed, ["4.8: no region", "5.8: ours is no number"]);
        let found = Thesis {
            seed: 1,
            models: Vec::new(),
            figures,
            failed,
        };
        let text = page::words(&found);
        assert!(text.contains("made up") && text.contains("failed: 4.8: no region"));
        assert!(page::page(&found, &Machine::read()).contains("5.8: ours is no number"));
        // All that there is to say, with its status.
        let none = measure_all(&mut study, &[refused, no_number]);
        assert_eq!(none.err(), Some(Failure::Input("no region".to_string())));
    }

    #[test]
    fn a_figure_is_chosen_by_its_number() {
        assert_eq!(chosen(None).map(|all| all.len()), Ok(FIGURES.len()));
        assert_eq!(chosen(Some("4.7")).map(|one| one[0].0), Ok("4.7"));
        let refused = chosen(Some("4.3")).map(|_| ()).unwrap_err().to_string();
        assert!(refused.contains("4.7, 4.3.2"), "{refused}");
    }
}
