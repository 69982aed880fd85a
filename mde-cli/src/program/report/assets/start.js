// Draws the page, and marks it as done or as failed with the reason.

const page = document.getElementById("page");
page.replaceChildren();
Promise.resolve(report.kind === "run" ? runPage(page) : evaluationPage(page)).then(
  () => { document.documentElement.dataset.ready = "yes"; },
  (error) => {
    console.error(error);
    document.documentElement.dataset.ready = "failed";
    page.append(make("p", { class: "warning" }, `This page could not be drawn: ${error.message}. A browser of 2023 or newer is needed.`));
  });
