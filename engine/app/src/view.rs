//! `sfg view`, and the page of a run that happens now.

use crate::check::BadInput;
use crate::exit;
use crate::say::say;
use anyhow::Result;
use sfg_monitor::{Control, DEFAULT_PORT, ImageKind, MonitorError, Options, Server, Store};
use sfg_record::{Recorded, Tap};
use std::net::IpAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const LOOK: Duration = Duration::from_millis(100);

/// Runs to show.
#[derive(clap::Args)]
pub(crate) struct ViewOptions {
    /// Folder of a run, or its run.mcap; two are shown side by side.
    #[arg(required = true, num_args = 1..=2, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Port of the page on this machine.
    #[arg(long, value_name = "PORT", default_value_t = DEFAULT_PORT)]
    port: u16,
    #[command(flatten)]
    exposed: ExposedOptions,
}

/// The page of a run that happens now.
#[derive(clap::Args, Clone, Default)]
pub(crate) struct LiveOptions {
    /// Shows the run on a page at this port of this machine while it happens.
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "8787", conflicts_with = "no_recording")]
    view: Option<u16>,
    /// Lets the page pause, step and stop the run, set breakpoints and force results.
    #[arg(long, requires = "view")]
    control: bool,
    /// Waits before the first tick until the page says to go on.
    #[arg(long, requires = "control")]
    pause: bool,
    #[command(flatten)]
    exposed: ExposedOptions,
}

/// Who may see the page beside this machine.
#[derive(clap::Args, Clone, Default)]
pub(crate) struct ExposedOptions {
    /// Address at which other machines may see the page, for example that of this machine in the laboratory; needs --token.
    #[arg(long, value_name = "ADDRESS")]
    address: Option<IpAddr>,
    /// Word that the page's address must contain when other machines may see it.
    #[arg(long, value_name = "TOKEN")]
    token: Option<String>,
}

fn serve(
    port: u16,
    port_option: &'static str,
    exposed: &ExposedOptions,
    runs: Vec<Arc<Store>>,
    control: Option<Arc<Control>>,
) -> Result<Server> {
    let options = Options { address: exposed.address, token: exposed.token.clone(), port, port_option };
    Server::start(&options, runs, control).map_err(|error| match error {
        MonitorError::Io { .. } => error.into(),
        _ => BadInput(error.to_string()).into(),
    })
}

/// Shows runs until Ctrl-C.
pub(crate) fn view(options: &ViewOptions, interrupted: &AtomicBool) -> Result<ExitCode> {
    let open = |path: &PathBuf| Store::open(path).map(Arc::new).map_err(|error| BadInput(error.to_string()));
    let runs = options.runs.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let server = serve(options.port, "port", &options.exposed, runs, None)?;
    say!("open {} in a browser; Ctrl-C ends", server.url());
    while !interrupted.load(Ordering::Relaxed) {
        std::thread::sleep(LOOK);
    }
    Ok(ExitCode::from(exit::SUCCESS))
}

/// The page of a run that happens now.
pub(crate) struct LivePage {
    server: Server,
    store: Arc<Store>,
    control: Option<Arc<Control>>,
}

impl LivePage {
    /// Opens the page, if the user asked for it; says where.
    pub(crate) fn open(options: &LiveOptions, name: &str) -> Result<Option<Self>> {
        let Some(port) = options.view else {
            if options.exposed.address.is_some() || options.exposed.token.is_some() {
                return Err(BadInput("--address and --token are for the page: they need --view".to_owned()).into());
            }
            return Ok(None);
        };
        let store = Arc::new(Store::live(name));
        let new = if options.pause { Control::paused } else { Control::new };
        let control = options.control.then(|| Arc::new(new()));
        let server = serve(port, "view", &options.exposed, vec![Arc::clone(&store)], control.clone())?;
        say!("open {} in a browser to look on", server.url());
        Ok(Some(Self { server, store, control }))
    }

    /// What the recording tells the page.
    pub(crate) fn tap(&self) -> Tap {
        let store = Arc::clone(&self.store);
        Arc::new(move |recorded: &Recorded<'_>| match *recorded {
            Recorded::Message { topic, log_time_ns, bytes, .. } => store.push(topic, log_time_ns as f64 * 1e-9, bytes),
            Recorded::Image { camera, kind, log_time_ns, bytes } => {
                let kind = match kind {
                    sfg_record::views::ImageKind::Colour => ImageKind::Colour,
                    sfg_record::views::ImageKind::Depth => ImageKind::Depth,
                };
                store.push_image(camera, kind, log_time_ns as f64 * 1e-9, bytes);
            }
        })
    }

    /// The gate, where the page may control the run.
    pub(crate) fn control(&self) -> Option<&Control> {
        self.control.as_deref()
    }

    /// The run is over: the page stays as long as somebody looks at it, or until Ctrl-C.
    pub(crate) fn finish(self, interrupted: &AtomicBool) {
        self.store.end();
        if let Some(control) = &self.control {
            control.end();
        }
        if self.server.n_viewers() > 0 && !interrupted.load(Ordering::Relaxed) {
            say!("the page stays while it is looked at; Ctrl-C ends");
        }
        while self.server.n_viewers() > 0 && !interrupted.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
        }
    }
}
