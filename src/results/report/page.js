// Which sections a page has, and what stands above and below them. A new kind of page is one more entry.

const PAGES = {
  calibration: { title: "Calibration report", sections: [
    ["verdict", "Verdict", calibrationVerdict], ["provenance", "Provenance", provenance], ["accuracy", "Accuracy", accuracy],
    ["enter", "Enter this on the controller", enterThis, "Enter this"],
    ["robot", "The robot in 3D", robotInSpace, "3D"], ["residuals", "Residuals", residuals], ["parameters", "Parameters", parameters],
    ["effects", "Effects beyond geometry", effects, "Effects"], ["influence", "Influence and convergence", influence, "Influence"],
    ["next", "What to measure next", next, "Next"]] },
  validation: { title: "Validation report", sections: [
    ["verdict", "Verdict", validationVerdict], ["provenance", "Provenance", provenance], ["accuracy", "Accuracy", validationAccuracy],
    ["robot", "The robot in 3D", robotInSpace], ["residuals", "Residuals", residuals]] },
  comparison: { title: "Comparison of two calibrations", sections: [
    ["verdict", "Verdict", comparisonVerdict], ["provenance", "Provenance", provenance], ["parameters", "Parameters", changedParameters]] },
  compensation: { title: "Compensated program", sections: [
    ["verdict", "Verdict", compensationVerdict], ["provenance", "Provenance", provenance], ["corrections", "Corrections", corrections],
    ["bounded", "Where it is not exact", boundedPoints, "Not exact"]] },
  plan: { title: "Measuring plan", sections: [
    ["verdict", "The plan", planVerdict], ["accuracy", "Predicted accuracy", planAccuracy], ["robot", "Configurations in 3D", planInSpace]] },
  monte_carlo: { title: "Monte Carlo report", sections: [
    ["verdict", "Verdict", monteCarloVerdict], ["accuracy", "Held-out errors against the prediction", monteCarloErrors]] },
  two_step: { title: "Two-step procedure", sections: [
    ["verdict", "Verdict", twoStepVerdict], ["convergence", "Convergence by round", convergence], ["truth", "Estimated beside true parameters", againstTruth]] },
};

function saveJson() {
  const link = el("a", { download: (DATA.kind || "report") + ".json", href: URL.createObjectURL(new Blob([JSON.stringify(DATA, null, 2)], { type: "application/json" })) });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// The foot of every printed page, its paper if that is stated, and folded lists opened.
function preparePrinting(name) {
  const quoted = (text) => '"' + Array.from(text, (c) => (/[\w ,.()-]/.test(c) ? c : `\\${c.codePointAt(0).toString(16)} `)).join("") + '"';
  const foot = "font: 8.5pt sans-serif; color: #5d6670;";
  document.head.append(el("style", {}, `@page { ${DATA.paper ? `size: ${DATA.paper};` : ""}
    @bottom-left { content: ${quoted(name)}; ${foot} } @bottom-right { content: "page " counter(page) " of " counter(pages); ${foot} } }`));
  const opened = [];
  addEventListener("beforeprint", () => {
    for (const list of document.querySelectorAll("details:not([open])")) {
      list.open = true;
      opened.push(list);
    }
  });
  addEventListener("afterprint", () => { for (const list of opened.splice(0)) list.open = false; });
}

function start() {
  const page = PAGES[DATA.kind] || { title: "Report", sections: [] };
  const stated = (DATA.setup || []).find(([key]) => key === "robot");
  const subject = DATA.robot ? DATA.robot.name : stated ? stated[1] : String((RESULT.input || {}).urdf || "").split("/").pop();
  const serial = noteOf("serial");
  document.title = `${page.title}${subject ? ": " + cut(subject, 60) : ""}`;
  document.getElementById("top").append(el("div", { class: "inner" },
    el("p", { class: "over" }, page.title),
    el("h1", {}, subject ? named(subject, 80) : page.title),
    serial ? el("p", { class: "serial" }, "serial ", named(serial, 80)) : null,
    el("button", { type: "button", class: "save", onclick: saveJson }, "Save the numbers (JSON)")));
  const main = document.getElementById("report");
  main.replaceChildren();
  const contents = document.getElementById("contents");
  const list = el("ol", {});
  page.sections.forEach(([id, title, content, name], index) => {
    const section = el("section", { id, "aria-labelledby": id + "-title" }, el("h2", { id: id + "-title" }, el("span", { class: "count" }, String(index + 1)), title));
    main.append(section);
    try {
      section.append(...[content()].flat(3).filter((node) => node !== null && node !== undefined && node !== false));
    } catch (error) {
      section.append(missing("This section could not be drawn: " + error.message));
      console.error(error);
    }
    list.append(el("li", {}, el("a", { href: "#" + id }, name || title)));
  });
  contents.append(list);
  const software = RESULT.software || DATA.software || {};
  document.getElementById("end").append(el("div", { class: "inner" },
    el("p", {}, `${software.name || "kdl_calibration"} ${software.version || ""}. Lengths in millimetres, angles in degrees, unless stated. `,
      "In a chart that has the focus the arrow keys name one point after the other, Enter chooses its configuration. This file holds all it shows and loads nothing."),
    el("div", { class: "signature" }, ["Date", "Name", "Signature"].map((line) => el("span", {}, line)))));
  preparePrinting([page.title, subject, serial ? `serial ${serial}` : null].filter(Boolean).map((text) => cut(text, 60)).join(", "));
  select(CONFIGURATIONS.length ? 0 : -1);
}
window.kdlcal = { data: DATA, points: POINTS, predictedPoint, framesAt, moved, select, selected: SELECTED };
start();
