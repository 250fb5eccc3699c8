// Unpacks the packaged browser into TMPDIR and prints the path of its executable.
// Its shared libraries are unpacked where the package believes that it runs on the service it was made for.
process.env.AWS_EXECUTION_ENV = "AWS_Lambda_nodejs20.x";
const { default: chromium } = await import("@sparticuz/chromium");
console.log(await chromium.executablePath());
