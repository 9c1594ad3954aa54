// Files that the page writes: figures as SVG and PNG, traces as CSV.

export function download(content, name, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function saveTrace(text) {
  download(text, "trace.csv", "text/csv");
}

/** An SVG as it stands, or as a PNG of twice its size. */
export function saveFigure(svg, name, kind) {
  const text = new XMLSerializer().serializeToString(svg);
  if (kind === "svg") {
    download(text, name, "image/svg+xml");
    return;
  }
  const image = new Image();
  image.onload = () => {
    const canvas = document.createElement("canvas");
    canvas.width = 2 * image.width;
    canvas.height = 2 * image.height;
    canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
    canvas.toBlob((blob) => download(blob, name, "image/png"), "image/png");
  };
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
}
