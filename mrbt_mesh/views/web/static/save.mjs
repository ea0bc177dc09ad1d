// The menu of files. The server makes them; a picture is the server's drawing, painted here.

import { toast } from "./control.mjs";
import { byId, placeMenu } from "./text.mjs";

const TIMES_AS_LARGE = 2;

async function savePicture() {
  const file = "export/timeline.svg", { headers } = await fetch(file, { method: "HEAD" });
  const image = new Image(), canvas = document.createElement("canvas");
  image.src = file;
  await image.decode();
  canvas.width = image.width * TIMES_AS_LARGE;
  canvas.height = image.height * TIMES_AS_LARGE;
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(await new Promise((done) => canvas.toBlob(done)));
  link.download = headers.get("content-disposition").match(/filename="(.*)\.svg"/)[1] + ".png";
  link.click();
  URL.revokeObjectURL(link.href);
}

export function offerFiles() {
  const menu = byId("save-menu");
  byId("save").addEventListener("click", () => placeMenu(menu, byId("save")));
  menu.addEventListener("click", (event) => { if (event.target.closest("a, button")) menu.hidePopover(); });
  byId("save-png").addEventListener("click", () => savePicture().catch(() => toast("The server does not answer.")));
}
