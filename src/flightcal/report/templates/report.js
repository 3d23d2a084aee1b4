"use strict";
// Draws every figure from the data that the page carries, in the colours of the reader's theme.
(() => {
  // Base 85, in which <, > and & are written as other characters; then zlib.
  const alphabet = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%:()*+-;,=.?@^_`{|}~";
  const unpacked = async (id) => {
    const text = document.getElementById(id).textContent;
    const value = new Uint8Array(128);
    [...alphabet].forEach((character, i) => (value[character.charCodeAt(0)] = i));
    const bytes = new Uint8Array(Math.ceil(text.length / 5) * 4);
    for (let i = 0, j = 0; i < text.length; i += 5) {
      let group = 0;
      for (let k = 0; k < 5; k += 1) group = group * 85 + (i + k < text.length ? value[text.charCodeAt(i + k)] : 84);
      for (let shift = 24; shift >= 0; shift -= 8) bytes[j++] = (group >>> shift) & 255;
    }
    const length = Math.floor((text.length * 4) / 5);
    const stream = new Blob([bytes.subarray(0, length)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).text();
  };

  let dark = {};
  let drawn = {};
  let arrays = [];
  const times = ({ first, unit, steps }) => {
    let now = first;
    return steps.map((step) => new Date((now += step * unit)).toISOString().slice(0, -1));
  };
  const numbers = ({ digits, steps }) => {
    const scale = 10 ** Math.abs(digits);
    let now = 0;
    return steps.map((step) => (step === null ? null : ((now += step), digits < 0 ? now * scale : now / scale)));
  };
  const array = (number) => {
    const found = arrays[number];
    return (found.values ??= found.digits === undefined ? times(found) : numbers(found));
  };

  // Plotly reads a number on a time axis as local time and text as it stands: UTC, here.
  const prepared = (value, isDark) => {
    if (Array.isArray(value)) return value.map((item) => prepared(item, isDark));
    if (value !== null && typeof value === "object") {
      if (Number.isInteger(value.array)) return array(value.array);
      if (Array.isArray(value.columns)) {
        const columns = value.columns.map(array);
        return columns[0].map((_, i) => columns.map((column) => column[i]));
      }
      return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, prepared(item, isDark)]));
    }
    return isDark && typeof value === "string" && Object.hasOwn(dark, value) ? dark[value] : value;
  };

  const preference = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const isDark = () => (chosen === null ? preference.matches : chosen === "dark");
  const theme = () => (isDark() ? "dark" : "light");

  const draw = (plot) => {
    const { data, layout } = prepared(drawn.figures[plot.id], isDark());
    layout.template = prepared(drawn.template, isDark());
    const style = getComputedStyle(document.documentElement);
    layout.hoverlabel = {
      ...layout.hoverlabel,
      bgcolor: style.getPropertyValue("--card").trim(),
      bordercolor: style.getPropertyValue("--line").trim(),
    };
    layout.hoverlabel.font = { ...layout.hoverlabel.font, color: style.getPropertyValue("--text").trim() };
    const slim = innerWidth < 640;
    if (slim) {
      layout.margin = { ...layout.margin, r: 12 };
      // Titles begin at the figure's edge, for they are as long as on a wide screen.
      layout.annotations = layout.annotations?.map((own) =>
        own.x === 0 && own.xanchor === "left" ? { ...own, xshift: 4 - layout.margin.l } : own,
      );
    }
    layout.modebar = { ...layout.modebar, bgcolor: "rgba(0,0,0,0)", color: "#8a8f98", activecolor: "#3b82f6" };
    const config = {
      responsive: true,
      displayModeBar: slim || layout.meta?.tools === false ? false : "hover",
      displaylogo: false,
      plotlyServerURL: "",
      // Flight data stay here: no button may send a chart away.
      modeBarButtonsToRemove: ["sendChartToCloud", "select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { filename: plot.id, scale: 2 },
    };
    plot.dataset.drawn = theme();
    return Plotly.react(plot, data, layout, config);
  };

  const plots = [...document.querySelectorAll(".plot")];
  const isFolded = (element) => element.closest("details:not([open])") !== null;
  const waiting = () => plots.find((plot) => plot.dataset.drawn !== theme() && !isFolded(plot));
  // One after the other, so that the text can be read while the figures come; what is folded, when it is opened.
  const drawWaiting = async () => {
    for (let plot = waiting(); plot; plot = waiting()) {
      await draw(plot);
      await new Promise((resolve) => setTimeout(resolve, 0));
    }
    document.documentElement.dataset.figures = "drawn";
  };
  const ready = Promise.all([unpacked("plotly"), unpacked("drawn")]).then(([library, content]) => {
    const script = document.createElement("script");
    script.textContent = library;
    document.head.append(script);
    drawn = JSON.parse(content);
    ({ arrays, dark } = drawn);
  });
  let drawing = ready;
  const redraw = () => {
    document.documentElement.dataset.theme = theme();
    drawing = drawing
      .then(() => {
        document.querySelectorAll("[data-colour]").forEach((mark) => {
          mark.style.color = prepared(mark.dataset.colour, isDark());
        });
      })
      .then(drawWaiting);
  };
  ready.catch(() => document.querySelectorAll(".plot").forEach((plot) => {
    plot.textContent = "This browser cannot draw the figures: any of 2023 or later can.";
  }));
  document.addEventListener("toggle", redraw, true);

  // A link to what is folded opens it.
  const reveal = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (target === null || !isFolded(target)) return;
    for (let parent = target; parent; parent = parent.parentElement?.closest("details:not([open])")) {
      if (parent.tagName === "DETAILS") parent.open = true;
    }
    target.scrollIntoView({ behavior: "instant" });
  };
  addEventListener("hashchange", reveal);
  document.addEventListener("click", (event) => {
    if (event.target.closest?.("a[href^='#']")) setTimeout(reveal, 0);
  });

  // On paper everything is open, and figures are as wide as it.
  let folded = [];
  const fit = (layout) => {
    for (const plot of plots) if (plot.dataset.drawn) Plotly.relayout(plot, layout(plot));
  };
  addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll("main details:not([open])")];
    folded.forEach((element) => (element.open = true));
    document.documentElement.classList.add("paper");
    if (window.Plotly) for (let plot = waiting(); plot; plot = waiting()) draw(plot);
    fit((plot) => ({ width: plot.clientWidth, autosize: false }));
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("paper");
    folded.forEach((element) => (element.open = false));
    fit(() => ({ width: null, autosize: true }));
  });

  document.getElementById("theme").addEventListener("click", () => {
    chosen = isDark() ? "light" : "dark";
    redraw();
  });
  preference.addEventListener("change", redraw);

  // Other pages than a run's have their contents at the side.
  const contents = document.getElementById("contents");
  if (contents !== null) {
    const narrow = matchMedia("(max-width: 1000px)");
    const fold = () => (contents.open = !narrow.matches);
    narrow.addEventListener("change", fold);
    contents.addEventListener("click", (event) => {
      if (event.target.tagName === "A" && narrow.matches) contents.open = false;
    });
    fold();
    const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
    const spy = new IntersectionObserver(
      (entries) => {
        for (const { target, isIntersecting } of entries) {
          links.get(target.id)?.classList.toggle("here", isIntersecting);
        }
      },
      { rootMargin: "-20% 0px -70% 0px" },
    );
    document.querySelectorAll("main section").forEach((section) => spy.observe(section));
  }

  redraw();
  reveal();
})();
