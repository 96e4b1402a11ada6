// A file of the person at the browser, sent as it is; the server says where it keeps it.
export default {
  template: `
    <div class="lab-field">
      <label :for="id">{{ options.label }}</label>
      <span class="lab-field-input"><input type="file" :id="id" :accept="options.accept" @change="send($event.target.files[0])"></span>
      <p v-if="message" role="alert" class="lab-bad lab-field-message">{{ message }}</p>
    </div>`,
  props: { options: Object },
  data() {
    return { id: `lab-file-${Math.random().toString(36).slice(2)}`, message: "" };
  },
  methods: {
    async send(file) {
      if (!file) return;
      this.message = "";
      if (file.size > this.options.most) {
        this.message = `The file has ${(file.size / 2 ** 20).toFixed(0)} MiB, at most ${this.options.most / 2 ** 20} can be sent; copy it into the folder of this page.`;
        return;
      }
      try {
        const answer = await fetch(`/uploads?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
        const told = await answer.json();
        if (answer.ok) this.$emit("sent", told);
        else this.message = told.message;
      } catch (error) {
        this.message = `The file could not be sent: ${error.message}`;
      }
    },
  },
};
