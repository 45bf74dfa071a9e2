//! A headless Chromium and the little of its DevTools protocol that the tests need.

use serde_json::{Value, json};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

/// Names under which it is installed.
const PROGRAMS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// No answer of the browser takes nearly as long, even where everything is drawn in software on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A browser of our own, with a profile that goes with it.
pub(crate) struct Chromium {
    child: Child,
    socket: WebSocket<TcpStream>,
    next_id: u64,
    events: Vec<Value>,
    _profile: tempfile::TempDir,
}

/// Where a browser is installed.
pub(crate) fn installed() -> Option<PathBuf> {
    let folders: Vec<PathBuf> = std::env::var_os("PATH").map(|path| std::env::split_paths(&path).collect()).unwrap_or_default();
    PROGRAMS.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|path| path.is_file())
}

impl Chromium {
    /// Starts `program` with `further` arguments.
    pub(crate) fn start(program: &Path, further: &[&str]) -> Self {
        let profile = tempfile::tempdir().unwrap();
        let mut child = Command::new(program)
            .args(["--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader"])
            .args(["--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--no-first-run", "--hide-scrollbars"])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .args(further)
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Written once the port is open: the port, then the path of the browser's own socket.
        let told = profile.path().join("DevToolsActivePort");
        let begun = Instant::now();
        let (port, path) = loop {
            let text = std::fs::read_to_string(&told).unwrap_or_default();
            if let Some((port, path)) = text.split_once('\n')
                && !path.is_empty()
                && let Ok(port) = port.parse::<u16>()
            {
                break (port, path.trim().to_owned());
            }
            if begun.elapsed() > PATIENCE || child.try_wait().unwrap().is_some() {
                drop(child.kill());
                panic!("{} does not come up", program.display());
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        let stream = TcpStream::connect(("127.0.0.1", port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // Screenshots are large.
        let config = tungstenite::protocol::WebSocketConfig::default().max_message_size(None).max_frame_size(None);
        let url = format!("ws://127.0.0.1:{port}{path}");
        let (socket, _) = tungstenite::client::client_with_config(url, stream, Some(config)).unwrap();
        Self { child, socket, next_id: 0, events: Vec::new(), _profile: profile }
    }

    /// Sends a command and waits for its answer; what comes in between is kept.
    fn call(&mut self, session: Option<&str>, method: &str, params: &Value) -> Value {
        self.next_id += 1;
        let mut request = json!({"id": self.next_id, "method": method, "params": params});
        if let Some(session) = session {
            request["sessionId"] = json!(session);
        }
        self.socket.send(Message::text(request.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let mut message: Value = serde_json::from_str(&text).unwrap();
            if message["id"] == self.next_id {
                assert!(message["error"].is_null(), "{method}: {}", message["error"]);
                return message["result"].take();
            }
            self.events.push(message);
        }
    }

    /// An empty page of `width x height` CSS pixels.
    pub(crate) fn page(&mut self, width: u32, height: u32) -> Page<'_> {
        let target = self.call(None, "Target.createTarget", &json!({"url": "about:blank"}));
        let target_id = target["targetId"].clone();
        let attached = self.call(None, "Target.attachToTarget", &json!({"targetId": target_id, "flatten": true}));
        let session = attached["sessionId"].as_str().unwrap().to_owned();
        let mut page = Page { browser: self, session, target_id };
        for domain in ["Page", "Runtime", "Log", "Network"] {
            page.call(&format!("{domain}.enable"), &json!({}));
        }
        let metrics = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": false});
        page.call("Emulation.setDeviceMetricsOverride", &metrics);
        page
    }
}

impl Drop for Chromium {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// One page of the browser.
pub(crate) struct Page<'a> {
    browser: &'a mut Chromium,
    session: String,
    target_id: Value,
}

impl Page<'_> {
    fn call(&mut self, method: &str, params: &Value) -> Value {
        let session = self.session.clone();
        self.browser.call(Some(&session), method, params)
    }

    pub(crate) fn open(&mut self, url: &str) {
        let answer = self.call("Page.navigate", &json!({"url": url}));
        assert!(answer["errorText"].is_null(), "{url}: {}", answer["errorText"]);
    }

    /// `light` or `dark`, as the user's system asks for.
    pub(crate) fn prefer(&mut self, scheme: &str) {
        let features = json!([{"name": "prefers-color-scheme", "value": scheme}]);
        self.call("Emulation.setEmulatedMedia", &json!({"features": features}));
    }

    /// The value of an expression, awaited.
    pub(crate) fn eval(&mut self, expression: &str) -> Value {
        let params = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let mut answer = self.call("Runtime.evaluate", &params);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]["exception"]["description"]);
        answer["result"]["value"].take()
    }

    /// Waits until an expression is true; before the page is there, it may fail.
    pub(crate) fn wait_for(&mut self, expression: &str) {
        let begun = Instant::now();
        let guarded = format!("(() => {{ try {{ return Boolean({expression}); }} catch {{ return false; }} }})()");
        while self.eval(&guarded) != true {
            assert!(begun.elapsed() < PATIENCE, "never became true: {expression}\n{:#?}", self.complaints());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Lets the page draw what it has to draw.
    pub(crate) fn settle(&mut self) {
        self.eval("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done, 0))))");
    }

    /// Moves the mouse to a place of the page, CSS pixels.
    pub(crate) fn point_at(&mut self, x: f64, y: f64) {
        self.call("Input.dispatchMouseEvent", &json!({"type": "mouseMoved", "x": x, "y": y, "button": "none", "buttons": 0}));
    }

    /// Presses and releases a key.
    pub(crate) fn press(&mut self, key: &str, code: &str) {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", &json!({"type": kind, "key": key, "code": code}));
        }
    }

    pub(crate) fn screenshot(&mut self, path: &Path) {
        use base64::Engine as _;
        let answer = self.call("Page.captureScreenshot", &json!({"format": "png"}));
        let png = base64::engine::general_purpose::STANDARD.decode(answer["data"].as_str().unwrap()).unwrap();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, png).unwrap();
    }

    /// What the console and the network complained about since the browser started.
    pub(crate) fn complaints(&mut self) -> Vec<String> {
        // An answer to this comes after all events before it.
        self.eval("0");
        let of_page = self.browser.events.iter().filter(|event| event["sessionId"] == self.session.as_str());
        of_page.filter_map(complaint).collect()
    }
}

impl Drop for Page<'_> {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let target = json!({"targetId": self.target_id});
            self.browser.call(None, "Target.closeTarget", &target);
        }
    }
}

/// What an event complains about, if it does.
fn complaint(event: &Value) -> Option<String> {
    let params = &event["params"];
    match event["method"].as_str()? {
        "Runtime.exceptionThrown" => Some(params["exceptionDetails"].to_string()),
        "Runtime.consoleAPICalled" => {
            matches!(params["type"].as_str(), Some("error" | "warning" | "assert")).then(|| params["args"].to_string())
        }
        "Log.entryAdded" => {
            let entry = &params["entry"];
            matches!(entry["level"].as_str(), Some("error" | "warning")).then(|| entry.to_string())
        }
        // A page that is left gives up what it was loading.
        "Network.loadingFailed" => (params["canceled"] != true).then(|| params.to_string()),
        "Network.responseReceived" => {
            let response = &params["response"];
            (response["status"].as_u64() >= Some(400)).then(|| format!("{}: {}", response["url"], response["status"]))
        }
        _ => None,
    }
}
